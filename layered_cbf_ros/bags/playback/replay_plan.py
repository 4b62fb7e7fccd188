"""What a replay will do, settled before anything is sent."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile

from layered_cbf_ros.bags.playback.command_line import Options
from layered_cbf_ros.bags.playback.fed_node import FedNode, fed_node
from layered_cbf_ros.bags.playback.selection import select
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S

CLOCK = '/clock'
JUMP_NS = NS_PER_S // 10  # several senders of a topic get in each other's way by less


@dataclass(frozen=True)
class ReplayPlan:
    """What is played.

    Attributes:
        names: Names to send under, by the topics of the bag.
        fed: The live node that gets its inputs, or None.
        begin_ns: Log time of the bag's first message [ns].
        start_ns: First log time to play [ns]; a fed node waits for nothing but its inputs.
        end_ns: Last log time to play [ns].
        notes: What a person should know beforehand, a line each.
    """

    names: Mapping[str, str]
    fed: FedNode | None
    begin_ns: int
    start_ns: int
    end_ns: int
    notes: tuple[str, ...]


def plan_replay(bag: Bag, options: Options) -> ReplayPlan:
    """Return what to do.

    Raises:
        BagError: If the bag can't be read or doesn't hold what was asked for.
    """
    begin_ns, last_ns = bag.span_ns
    start_ns = _start_ns(bag, options.start_offset)
    topics: Mapping[str, Topic] = bag.topics
    fed = fed_node(options.inputs_of, bag) if options.inputs_of else None
    if fed is not None:
        topics = {name: topics[name] for name in fed.inputs}
    names = select(topics, options.selection)
    if fed is not None and fed.leader not in names:
        raise BagError(f'{fed.name} does nothing without {fed.leader}; do not exclude it')
    if fed is not None and not options.start_offset:
        start_ns = next((r.log_time_ns for r in bag.in_time_order(names)), start_ns)
    if options.clock_hz and CLOCK in names.values():
        raise BagError(
            f'--clock: the bag has a {CLOCK} of its own; leave out --clock, or the other with '
            f'--exclude-topics {CLOCK}'
        )
    length = options.playback_duration
    end_ns = min(last_ns, start_ns + round(length * NS_PER_S)) if math.isfinite(length) else last_ns
    return ReplayPlan(names, fed, begin_ns, start_ns, end_ns, tuple(_notes(bag, names, fed)))


def records_of_round(bag: Bag, plan: ReplayPlan, topics: set[str]) -> Iterator[Record]:
    """Yield what one round plays, in the order of log time.

    Args:
        bag: The bag.
        plan: What is played.
        topics: Which of its topics can be.
    """
    start_ns = None if plan.start_ns == plan.begin_ns else plan.start_ns
    records = bag.in_time_order(topics, start_ns)
    return takewhile(lambda record: record.log_time_ns <= plan.end_ns, records)


def latched_before(bag: Bag, plan: ReplayPlan, depths: Mapping[str, int]) -> list[Record]:
    """Return the last messages of latched topics before the first log time to be played.

    Who had joined at that time would have got them; without them a replay from the
    middle would lack what was told once at the start.

    Args:
        bag: The bag.
        plan: What is played.
        depths: How many messages each latched topic keeps, 0 for all.
    """
    if not depths or plan.start_ns == plan.begin_ns:
        return []
    kept = {topic: deque[Record](maxlen=depth or None) for topic, depth in depths.items()}
    for record in bag.in_time_order(depths):
        if record.log_time_ns >= plan.start_ns:
            break
        kept[record.topic.name].append(record)
    found = [record for records in kept.values() for record in records]
    return sorted(found, key=lambda record: record.log_time_ns)


def _start_ns(bag: Bag, offset: float) -> int:
    """Return the log time that is an offset [s] behind the first [ns].

    Raises:
        BagError: If the bag doesn't reach that far.
    """
    begin_ns, last_ns = bag.span_ns
    if not bag.topics or (begin_ns, last_ns) == (0, 0):
        raise BagError(f'{bag.path} holds no message; there is nothing to play')
    start_ns = begin_ns + round(offset * NS_PER_S)
    if start_ns > last_ns:
        length = (last_ns - begin_ns) / NS_PER_S
        raise BagError(
            f'--start-offset {offset:g} s is beyond the end; the bag is {length:.3f} s long'
        )
    return start_ns


def _notes(bag: Bag, names: Mapping[str, str], fed: FedNode | None) -> Iterator[str]:
    for topic, back_ns in bag.went_back_ns.items():
        if topic in names and back_ns >= JUMP_NS:
            yield (
                f'{topic}: its log time goes back by {back_ns / NS_PER_S:.3f} s in the file; '
                'it is played in the order of log time'
            )
    if fed is not None and fed.absent:
        yield f'the bag has no {", ".join(fed.absent)}; {fed.name} goes without'
    if fed is not None and fed.was_steered:
        yield 'the run was steered by hand: only re_solve repeats what was asked, tick by tick'
