"""One core at its place in a stream of recorded messages: what it ticks on, and when."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from layered_cbf_ros.bags.resolving.cores import Core
from layered_cbf_ros.bags.resolving.recorded_tracks import ArrivedTracks, CompleteTracks
from layered_cbf_ros.bags.resolving.ticks import LockstepTicks, RealTimeTicks, Tick
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.node_topics import TRACKED, TRACKS
from layered_cbf_ros.scenario import Scenario


class Seat(Protocol):
    """A core with its ticks.

    Attributes:
        core: The core.
        topics: What it needs of the bag.
        needed: Those of them without which there is no tick.
    """

    core: Core
    topics: set[str]
    needed: set[str]

    @property
    def skipped(self) -> int:
        """Return the number of ticks, or recorded answers, whose inputs the bag lacks."""

    @property
    def from_start(self) -> bool:
        """Tell whether the core's memory is that of the run."""

    def take(self, record: Record) -> Iterator[Tick]:
        """Take a message of one of its topics; yield the ticks that are due."""

    def end(self) -> None:
        """Be told that there are no more messages; raises BagError if one is missing."""


class LockstepSeat:
    """Ticks by stamp, as in the run."""

    def __init__(self, core: Core, scenario: Scenario) -> None:
        self.core = core
        self.needed = {core.ticking, *core.rules}
        self.topics = set(self.needed)
        if TRACKS in core.rules:
            self.needed.add(TRACKED)
            self.topics.add(TRACKED)
        self._tracks = CompleteTracks(scenario)
        self._ticks = LockstepTicks(core.node, core.ticking, core.every_ns, core.rules)

    @property
    def skipped(self) -> int:
        """Return the number of ticks whose inputs the bag doesn't hold."""
        return self._ticks.skipped

    @property
    def from_start(self) -> bool:
        """Tell whether the bag holds the run from its first state on."""
        return self._ticks.from_start

    def take(self, record: Record) -> Iterator[Tick]:
        """Take a message; yield the ticks that are due."""
        topic = record.topic.name
        if topic == self.core.ticking:
            self._ticks.offer(topic, stamp_of(record.data), record)
        elif topic in (TRACKS, TRACKED):
            for stamp_ns, tracks in self._tracks.take(record):
                self._ticks.offer(TRACKS, stamp_ns, tracks)
        else:
            self._ticks.offer(topic, stamp_of(record.data), record.data)
        yield from self._ticks.due()

    def end(self) -> None:
        """Make sure that nothing is missing in between."""
        self._ticks.end()


class RealTimeSeat:
    """Ticks whenever an answer was recorded, on what it may have had by then."""

    from_start = True  # a node that comes late begins anew: its memory is no older

    def __init__(self, core: Core, scenario: Scenario) -> None:
        self.core = core
        self._pace = core.outputs[0]
        self.needed = {core.ticking, self._pace, *(set(core.rules) - {TRACKS})}
        self.topics = {*self.needed, *core.rules}
        self._arrived: ArrivedTracks | None = None
        if TRACKS in core.rules:
            self.topics.add(TRACKED)
            self._arrived = ArrivedTracks(scenario)
        rules = {topic: rule for topic, rule in core.rules.items() if topic != TRACKS}
        gathered = {} if self._arrived is None else {TRACKS: self._arrived}
        self._ticks = RealTimeTicks(core.ticking, rules, gathered)

    @property
    def skipped(self) -> int:
        """Return the number of recorded answers whose state the bag doesn't hold."""
        return self._ticks.skipped

    def take(self, record: Record) -> Iterator[Tick]:
        """Take a message; yield the tick whose answer it is."""
        topic = record.topic.name
        if self._arrived is not None and topic in (TRACKS, TRACKED):
            self._arrived.take(record)
        elif topic == self._pace:
            self._ticks.sent(stamp_of(record.data), record.publish_time_ns)
        else:
            content = record if topic == self.core.ticking else record.data
            self._ticks.offer(topic, stamp_of(record.data), content, record.log_time_ns)
        yield from self._ticks.due()

    def end(self) -> None:
        """Do nothing: what came was used."""


class ArrivalSeat:
    """Ticks on every message that comes, as the obstacle tracker does in real time."""

    from_start = True
    skipped = 0

    def __init__(self, core: Core) -> None:
        self.core = core
        self.needed = self.topics = {core.ticking}

    def take(self, record: Record) -> Iterator[Tick]:
        """Yield the message as a tick."""
        yield Tick(stamp_of(record.data), record, {})

    def end(self) -> None:
        """Do nothing."""


def seat_of(core: Core, scenario: Scenario) -> Seat:
    """Return the seat that a core has in its run."""
    if core.is_lockstep:
        return LockstepSeat(core, scenario)
    return RealTimeSeat(core, scenario) if core.waits_for_others else ArrivalSeat(core)
