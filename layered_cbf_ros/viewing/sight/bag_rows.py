"""What a bag has to show, thinned to the rate of the screen as it is read."""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np

from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import BagError, MessageError
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import points_from, track_from
from layered_cbf_ros.node_topics import COMMANDS, DIAGNOSTICS, TRACKS, TRUTH
from layered_cbf_ros.operation.told import E_STOP
from layered_cbf_ros.perception.known_tracks import track_radius
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.viewing.sight.node_sights import node_sights
from layered_cbf_ros.viewing.sight.obstacles import (
    tracked_obstacles,
    true_obstacles,
    velocities_between,
)
from layered_cbf_ros.viewing.sight.rows import Row, row_readers, state_topic
from layered_cbf_ros.viewing.sight.snapshot import NodeSight, ObstacleSight

EFFORT = 3  # of a JointTrajectory
PERIOD_NS = NS_PER_S // 50
"""Of what is kept; a person sees no more [ns]."""


class Kept:
    """Values by their stamps, in the order of time."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.values: list[Any] = []

    def wants(self, stamp_ns: int, period_ns: int = PERIOD_NS) -> bool:
        """Tell whether a value is late enough after the last one to be kept."""
        return not self.stamps_ns or stamp_ns >= self.stamps_ns[-1] + period_ns

    def add(self, stamp_ns: int, value: Any) -> None:
        """Keep a value that is wanted."""
        self.stamps_ns.append(stamp_ns)
        self.values.append(value)

    def at(self, stamp_ns: int) -> Any | None:
        """Return the newest value up to a stamp, None if there is none."""
        place = bisect_right(self.stamps_ns, stamp_ns) - 1
        return self.values[place] if place >= 0 else None


class BagRows:
    """Takes the messages of a bag; keeps what a screen can show of each topic.

    Attributes:
        topics: Those that tell something.
        unreadable: Messages that couldn't be read.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._readers = row_readers(scenario)
        self._rows = {topic: Kept() for topic in self._readers}
        self._clock = state_topic(scenario.robots[0])
        self._truth, self._tracks = Kept(), Kept()
        self._nodes: dict[str, Kept] = {}
        self._decoder = MessageDecoder()
        self._track_radius = track_radius(scenario)
        self.topics = frozenset((*self._readers, TRUTH, TRACKS, DIAGNOSTICS))
        self.unreadable = 0

    @property
    def stamps_ns(self) -> list[int]:
        """Return the stamps of all states that were kept [ns]."""
        return self._rows[self._clock].stamps_ns

    def take(self, record: Record) -> None:
        """Take one message of `topics`; one that can't be read is counted."""
        try:
            if record.topic.name == DIAGNOSTICS:
                self._take_diagnostics(record)
                return
            stamp_ns = stamp_of(record.data)
            if record.topic.name in self._readers:
                self._take_row(record, stamp_ns)
            elif record.topic.name == TRUTH and self._truth.wants(stamp_ns):
                self._truth.add(stamp_ns, points_from(self._decoder.decode(record)))
            elif record.topic.name == TRACKS:
                self._take_track(record, stamp_ns)
        except (BagError, MessageError):
            self.unreadable += 1

    def rows_at(self, stamp_ns: int) -> dict[str, Row]:
        """Return the newest row of each topic at a stamp."""
        found = {topic: kept.at(stamp_ns) for topic, kept in self._rows.items()}
        return {topic: row for topic, row in found.items() if row is not None}

    def obstacles_at(self, stamp_ns: int) -> tuple[ObstacleSight, ...]:
        """Return the obstacles at a stamp."""
        later = self._truth.at(stamp_ns)
        if later is None:
            tracks = self._tracks.at(stamp_ns) or {}
            return tracked_obstacles(list(tracks.values()))
        place = bisect_right(self._truth.stamps_ns, stamp_ns) - 1
        stamps, values = self._truth.stamps_ns, self._truth.values
        before = max(place - 1, 0)
        after = min(before + 1, len(stamps) - 1)
        velocities = velocities_between(
            (stamps[before], stamps[after]), values[before], values[after]
        )
        return true_obstacles(self._scenario.obstacles, later, velocities)

    def nodes_at(self, stamp_ns: int) -> tuple[NodeSight, ...]:
        """Return what each node had told by a stamp."""
        told = [self._nodes[name].at(stamp_ns) for name in sorted(self._nodes)]
        return tuple(sight for sight in told if sight is not None)

    def extremes(self, topic: str, leaving_out: str = '') -> tuple[list[int], Array]:
        """Return the smallest and largest first field of every row of a topic.

        Args:
            topic: Where it was told.
            leaving_out: End of the names that don't count, '' if all do.

        Returns:
            Stamps [ns] (k,) and the two values, NaN where nothing counts, (k, 2).
        """
        kept = self._rows[topic]
        found = np.full((len(kept.values), 2), np.nan)
        for i, row in enumerate(kept.values):
            counts = [not leaving_out or not name.endswith(leaving_out) for name in row.names]
            values = row.values[0, counts]
            if np.isfinite(values).any():
                found[i] = np.nanmin(values), np.nanmax(values)
        return kept.stamps_ns, found

    def first_stop(self) -> int | None:
        """Return when the emergency stop was first latched [ns], None if it never was."""
        kept = self._rows[COMMANDS]
        for stamp_ns, row in zip(kept.stamps_ns, kept.values, strict=True):
            if row.picked([E_STOP])[EFFORT, 0] == 1.0:
                return stamp_ns
        return None

    def _take_row(self, record: Record, stamp_ns: int) -> None:
        kept = self._rows[record.topic.name]
        if not kept.wants(stamp_ns):
            return
        row = self._readers[record.topic.name].newest(record.data)
        if row is not None and kept.wants(row.stamp_ns):
            kept.add(row.stamp_ns, row)

    def _take_track(self, record: Record, stamp_ns: int) -> None:
        """Keep the tracks of one stamp together; each is a message of its own."""
        stamps = self._tracks.stamps_ns
        if stamps and stamps[-1] == stamp_ns:
            tracks = self._tracks.values[-1]
        elif self._tracks.wants(stamp_ns):
            self._tracks.add(stamp_ns, tracks := {})
        else:
            return
        track = track_from(self._decoder.decode(record), self._track_radius)
        tracks[track.name] = track

    def _take_diagnostics(self, record: Record) -> None:
        """Keep what a node told, at the time of the newest state: its own stamp is wall time."""
        now_ns = self.stamps_ns[-1] if self.stamps_ns else 0
        for sight in node_sights(self._decoder.decode(record)):
            self._nodes.setdefault(sight.name, Kept()).add(now_ns, sight)
