"""Which messages of a bag are asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.yaml_entry import suggestion


@dataclass(frozen=True, slots=True)
class Selection:
    """Topics, and a part of the time.

    Attributes:
        topics: Their names; nothing for all.
        count: Most messages, in all; None for no limit.
        start_offset: What is left out at the begin of the bag [s].
        duration: How much of it from there on [s].
    """

    topics: tuple[str, ...] = ()
    count: int | None = None
    start_offset: float = 0.0
    duration: float = math.inf

    def check(self, bag: Bag) -> None:
        """Make sure that the bag has the topics.

        Raises:
            BagError: Naming the first that it lacks, and the nearest.
        """
        known = bag.topics
        for topic in self.topics:
            if topic not in known:
                raise BagError(
                    f"{bag.path} has no topic '{topic}'; {suggestion(topic, known)}"
                    f'`inspect {bag.path}` lists all {len(known)}'
                )

    def records(self, bag: Bag) -> Iterator[Record]:
        """Yield the messages in the order of time.

        Raises:
            BagError: If the bag lacks a topic or can't be read.
        """
        self.check(bag)
        topics = frozenset(self.topics or bag.topics)
        yield from islice(self._in_time(bag, topics), self.count)

    def _in_time(self, bag: Bag, topics: frozenset[str]) -> Iterator[Record]:
        if not self.start_offset and math.isinf(self.duration):
            yield from bag.in_time_order(topics)
            return
        start_ns = bag.span_ns[0] + round(self.start_offset * NS_PER_S)
        span_ns = self.duration * NS_PER_S
        for record in bag.in_time_order(topics, start_ns):
            if record.log_time_ns - start_ns > span_ns:
                return
            yield record
