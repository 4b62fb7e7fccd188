"""What re-solving found, as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from layered_cbf_ros.bags.resolving.plan_report import plan_lines
from layered_cbf_ros.bags.resolving.results import (
    NodeResult,
    QuantityResult,
    ResolveResult,
    TopicResult,
)
from layered_cbf_ros.bags.tables import aligned
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.timing import LOCKSTEP

REAL_TIME_NOTE = (
    'real time: which inputs a tick had is not recorded; the newest are taken that had come '
    'when its answer was sent'
)
OBEYED_NOTE = (
    'the robots are taken to follow the new plan exactly and upright, from where they were at '
    'the first tick; obstacles move as recorded'
)
INPUTS_NOTE = 'each node gets its recorded inputs: nothing that it changes comes back to it'


def text_of(result: ResolveResult) -> str:
    """Return the report."""
    lines = list(_head(result))
    for node in result.nodes:
        lines += _node_head(node, result.what_if)
        lines += plan_lines(node.plan) if node.plan else _topic_lines(node, result.what_if)
    return '\n'.join([*lines, '', judgement(result)])


def judgement(result: ResolveResult) -> str:
    """Return the answer in one line."""
    if result.what_if:
        overlaps = result.overlaps
        if not any(node.plan for node in result.nodes):
            return 'ANSWERED'
        return f'ANSWERED: {overlaps} overlaps of bodies' if overlaps else 'ANSWERED: no overlaps'
    if result.is_equal:
        return f'BIT-EQUAL: all {result.compared} outputs that were compared'
    worst = sorted({topic.topic for n in result.nodes for topic in n.topics if not topic.is_equal})
    return f'DIFFERENT: {", ".join(worst)}'


def _head(result: ResolveResult) -> Iterator[str]:
    yield f'bag        {result.bag}'
    yield f'scenario   {result.scenario}, {result.time}'
    yield (
        f're-solved  {result.recorded_time_s:.2f} s of ticks in {result.wall_time_s:.1f} s, '
        f'{result.recorded_time_s / max(result.wall_time_s, 1e-9):.2f} times real time'
    )
    if result.truncated:
        yield 'note       the bag is cut off or spoilt: only what is there is re-solved'
    if result.time != LOCKSTEP:
        yield f'note       {REAL_TIME_NOTE}'
    if result.what_if and any(node.plan for node in result.nodes):
        yield f'note       {OBEYED_NOTE}'
    if result.what_if and not all(node.plan for node in result.nodes):
        yield f'note       {INPUTS_NOTE}'
    if not result.filtered:
        yield 'note       the filter is off: the desired motion alone, within the input limits'


def _node_head(node: NodeResult, what_if: bool) -> Iterator[str]:
    yield ''
    yield f'{node.node}: {node.ticks} ticks'
    for name, (old, new) in node.changes.items():
        yield f'  {name} {new} instead of {old}'
    if what_if and not node.changes and not node.plan:
        yield '  no parameter differs from the recorded ones'
    if not node.from_start:
        yield (
            '  the bag starts in the middle of the run: what the node remembered is not known, '
            'and a difference at the start proves nothing'
        )
    if node.skipped:
        yield f'  {node.skipped} ticks have no inputs in the bag'
    if node.refused:
        yield f'  {node.refused} inputs were refused'
    if not what_if and node.recorded_failures not in (None, node.solver_failures):
        yield f'  solver failures: {node.recorded_failures} told, {node.solver_failures} re-solved'
    elif node.solver_failures or (what_if and not node.plan):
        told = '-' if node.recorded_failures is None else node.recorded_failures
        yield f'  solver failures: {told} recorded, {node.solver_failures} re-solved'


def _topic_lines(node: NodeResult, what_if: bool) -> Iterator[str]:
    heading = ('topic', 'compared', 'bit-equal', 'recorded only', 're-solved only', 'sent again')
    rows: list[tuple[str, ...]] = [heading]
    for topic in node.topics:
        if topic.in_bag:
            rows.append(_topic_row(topic))
        else:
            rows.append((topic.topic, 'not recorded', '', '', '', ''))
    yield from (f'  {line}' for line in aligned(rows))
    for topic in node.topics:
        yield from _difference_lines(topic, what_if)


def _topic_row(topic: TopicResult) -> tuple[str, ...]:
    counts = (
        topic.compared,
        topic.bit_equal,
        topic.recorded_only,
        topic.resolved_only,
        topic.repeated,
    )
    return (topic.topic, *map(str, counts))


def _difference_lines(topic: TopicResult, what_if: bool) -> Iterator[str]:
    if topic.first_different_ns is not None:
        yield f'  {topic.topic} differs from {topic.first_different_ns / NS_PER_S:.3f} s on:'
    if topic.unpaired_within:
        yield f'  {topic.topic}: {topic.unpaired_within} rows lack their partner in between'
    if topic.other_names:
        yield f'  {topic.topic}: {topic.other_names} rows name other things than recorded'
    for quantity in sorted(topic.quantities, key=lambda q: -q.largest):
        yield '    ' + _quantity_line(quantity, what_if)


def _quantity_line(q: QuantityResult, what_if: bool) -> str:
    at = '-' if q.stamp_ns is None else f'{q.stamp_ns / NS_PER_S:.3f} s'
    unit = f' {q.unit}' if q.unit else ''
    line = f'{q.quantity}: largest {q.largest:.6g}{unit} ({q.name} at {at})'
    if what_if:
        return f'{line}, mean {q.mean:.6g}{unit}, RMS {q.rms:.6g}{unit}'
    return f'{line}, {q.different} numbers differ'
