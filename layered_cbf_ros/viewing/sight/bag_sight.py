"""What is to be seen at any time of a bag."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from layered_cbf_ros.bags.recorded_scenario import recorded_scenario
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import CLEARANCE, INTERVENTION
from layered_cbf_ros.viewing.sight.assembly import Assembler
from layered_cbf_ros.viewing.sight.bag_rows import BagRows
from layered_cbf_ros.viewing.sight.rows import state_topic
from layered_cbf_ros.viewing.sight.snapshot import Snapshot


@dataclass(frozen=True, slots=True)
class Moment:
    """A time worth to be looked at.

    Attributes:
        name: What happens there.
        seconds: When, since the first state [s].
    """

    name: str
    seconds: float


class BagSight:
    """One bag, read once; also one that was cut off.

    Attributes:
        path: The bag.
        scenario: What was run.
        truncated: Whether the bag ends before its end.
        duration: From the first to the last state [s].
        moments: Where a person would jump to.
    """

    def __init__(self, path: Path) -> None:
        """Read the bag.

        Raises:
            BagError: If there is none, or it doesn't tell of a run.
        """
        bag = open_bag(path)
        self.path = path
        self.scenario = recorded_scenario(bag)
        self._rows = BagRows(self.scenario)
        for record in bag.records(self._rows.topics):
            self._rows.take(record)
        stamps = self._rows.stamps_ns
        if not stamps:
            topic = state_topic(self.scenario.robots[0])
            raise BagError(f'{path} has no {topic}: there is nothing to see; record it too')
        self.truncated = bag.truncated
        self._start_ns = stamps[0]
        self.duration = (stamps[-1] - stamps[0]) / NS_PER_S
        self._assembler = Assembler(self.scenario)
        self.moments = tuple(self._moments())

    def at(self, seconds: float) -> Snapshot:
        """Return what is to be seen at a time since the first state [s].

        The newest state up to then is shown, and what was known at its stamp.
        """
        stamps = self._rows.stamps_ns
        wanted_ns = self._start_ns + round(seconds * NS_PER_S)
        stamp_ns = stamps[max(bisect_right(stamps, wanted_ns) - 1, 0)]
        rows = self._rows
        return self._assembler.snapshot(
            stamp_ns, rows.rows_at(stamp_ns), rows.obstacles_at(stamp_ns), rows.nodes_at(stamp_ns)
        )

    def seconds(self, stamp_ns: int) -> float:
        """Return a stamp as time since the first state [s]."""
        return (stamp_ns - self._start_ns) / NS_PER_S

    def _moments(self) -> list[Moment]:
        """Return the smallest distance, the largest intervention and the emergency stop."""
        found = []
        stamps, distances = self._rows.extremes(CLEARANCE, leaving_out='~ground')
        if len(stamps) and np.isfinite(distances).any():
            found.append(self._moment('smallest distance', stamps, np.nanargmin(distances[:, 0])))
        stamps, interventions = self._rows.extremes(INTERVENTION)
        if len(stamps) and np.isfinite(interventions).any():
            place = np.nanargmax(interventions[:, 1])
            found.append(self._moment('largest intervention', stamps, place))
        stopped = self._rows.first_stop()
        if stopped is not None:
            found.append(Moment('emergency stop', self.seconds(stopped)))
        return found

    def _moment(self, name: str, stamps: list[int], place: np.intp) -> Moment:
        return Moment(name, self.seconds(stamps[int(place)]))
