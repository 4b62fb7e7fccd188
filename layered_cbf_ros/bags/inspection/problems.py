"""What is wrong with a bag, a line each: value, place and remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from layered_cbf_ros.bags.inspection.topic_statistics import TopicStatistics
from layered_cbf_ros.bags.recording.losses import REFUSED_NOTE, read_losses
from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.writer import FAILED_NOTE
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import (
    CLEARANCE,
    DIAGNOSTICS,
    PLAN,
    STATE,
    TRUTH,
    odometry,
    robot_state,
)
from layered_cbf_ros.scenario import A1, BASES

NAMED = 3
"""So many topics are named where the same is wrong with several."""


def problems_of(
    bag: Bag, statistics: Mapping[str, TopicStatistics], run: RunRecord
) -> Iterator[str]:
    """Yield what a pass through a bag found wrong.

    Args:
        bag: The bag, after the pass.
        statistics: Of each topic that has messages.
        run: What it tells of a run.
    """
    start_ns, _ = bag.log_span_ns
    if bag.truncated:
        yield cut_off(bag, bag.log_span_ns)
    elif not statistics:
        yield f'{bag.path} holds no message; record again'
    for _, topic in sorted(statistics.items()):
        yield from _misfits(topic, start_ns)
    yield from _recorder_losses(bag)
    yield from _stamp_jumps(statistics, start_ns)
    yield from _log_jumps(statistics, start_ns)
    if not bag.truncated:
        yield from _missing_topics(statistics, run)


def cut_off(bag: Bag, span_ns: tuple[int, int]) -> str:
    """Return the line on a bag that ends before its end.

    Args:
        bag: The bag.
        span_ns: Its first and last log time [ns], zeros without a message.
    """
    start_ns, end_ns = span_ns
    seconds = f'after {(end_ns - start_ns) / NS_PER_S:.3f} s or has lost a part'
    where = seconds if end_ns else 'before its first message'
    return f'{bag.path} is cut off {where}; `inspect --repair {bag.path}` finishes it'


def _misfits(topic: TopicStatistics, start_ns: int) -> Iterator[str]:
    if topic.bad_type:
        yield topic.bad_type
    if topic.misfits:
        reason, log_ns = topic.first_misfit
        yield (
            f'{topic.topic.name}: {topic.misfits} of {topic.count} messages are no '
            f'{topic.topic.type_name} and left out; the first, {_after(log_ns, start_ns)}, {reason}'
        )


def _recorder_losses(bag: Bag) -> Iterator[str]:
    """Yield what the recorder itself says that it missed."""
    try:
        losses = read_losses(bag.notes) or {}
    except BagError as error:
        yield f'{bag.path}: {error}'
        return
    lossy = {topic: each.lost for topic, each in sorted(losses.items()) if each.lost}
    if lossy:
        yield (
            f'{bag.path}: the recorder lost {sum(lossy.values())} messages of '
            f'{", ".join(lossy)}; record fewer topics or to a faster disk'
        )
    for topic, reason in sorted(bag.notes.get(REFUSED_NOTE, {}).items()):
        yield f'{bag.path}: {topic} was not recorded: {reason}'
    for reason in bag.notes.get(FAILED_NOTE, {}).values():
        yield f'{bag.path}: the recorder failed: {reason}'


def _stamp_jumps(statistics: Mapping[str, TopicStatistics], start_ns: int) -> Iterator[str]:
    """Yield one line for all topics whose stamps fall back: mostly it is the same clock."""
    jumps = [
        (topic.stamps.first_jump, name)
        for name, topic in statistics.items()
        if topic.stamps is not None and topic.stamps.first_jump is not None
    ]
    jumps.sort(key=lambda entry: (entry[0].log_time_ns, entry[1]))
    if jumps:
        (jump, name), *others = jumps
        yield (
            f'{name}: stamps jump back from {jump.from_ns / NS_PER_S:.3f} to '
            f'{jump.to_ns / NS_PER_S:.3f} s, {_after(jump.log_time_ns, start_ns)}'
            f'{_so_do([other for _, other in others])}; judge the parts before and after alone'
        )


def _log_jumps(statistics: Mapping[str, TopicStatistics], start_ns: int) -> Iterator[str]:
    jumps = [topic for topic in statistics.values() if topic.log_jumps]
    jumps.sort(key=lambda topic: topic.log_jump_from_ns)
    if jumps:
        first, *others = jumps
        yield (
            f'{first.topic.name}: log times jump back by {first.log_jump_ns / NS_PER_S:.3f} s, '
            f'{_after(first.log_jump_from_ns, start_ns)}'
            f'{_so_do([topic.topic.name for topic in others])}; '
            'the clock of the machine was set, go by the stamps'
        )


def _missing_topics(statistics: Mapping[str, TopicStatistics], run: RunRecord) -> Iterator[str]:
    """Yield one line that names all topics that the bag of such a run must have."""
    scenario = run.scenario
    if scenario is None:
        return
    states = [STATE]
    if scenario.plant == BASES:
        states = [odometry(robot.name) for robot in scenario.robots]
    elif scenario.plant == A1:
        states = [robot_state(robot.name) for robot in scenario.robots]
    needed = [*states, PLAN, DIAGNOSTICS, CLEARANCE, *([TRUTH] if scenario.obstacles else [])]
    missing = [topic for topic in needed if topic not in statistics]
    if missing:
        yield (
            f"{run.path}: a run's bag must have {', '.join(missing)}, which it lacks; "
            'record all topics'
        )


def _after(log_ns: int, start_ns: int) -> str:
    return f'{(log_ns - start_ns) / NS_PER_S:.3f} s after the start'


def _so_do(names: list[str]) -> str:
    """Say that others do the same."""
    if not names:
        return ''
    more = f' and {len(names) - NAMED} more' if len(names) > NAMED else ''
    return f' (so do {", ".join(names[:NAMED])}{more})'
