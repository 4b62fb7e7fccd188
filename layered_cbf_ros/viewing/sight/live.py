"""The newest of everything that is heard of a running graph, as one snapshot."""

from __future__ import annotations

import json
from typing import Any

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.interfaces import Array, Track
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import from_json
from layered_cbf_ros.viewing.sight.assembly import Assembler
from layered_cbf_ros.viewing.sight.node_sights import heard_nodes, node_sights
from layered_cbf_ros.viewing.sight.obstacles import (
    tracked_obstacles,
    true_obstacles,
    velocities_between,
)
from layered_cbf_ros.viewing.sight.rows import Row, RowReader, row_readers, state_topic
from layered_cbf_ros.viewing.sight.snapshot import NodeSight, ObstacleSight, Snapshot

SIMULATOR = '/simulator'


class LiveSight:
    """Folds messages into what is to be seen now.

    Attributes:
        scenario: What is run, None before that is known.
        rejected: Messages that couldn't be read.
        runs: How many runs have begun; a new one may have other robots.
    """

    def __init__(self) -> None:
        self.scenario: Scenario | None = None
        self.rejected = self.runs = 0
        self._nodes: dict[str, tuple[NodeSight, float]] = {}
        self._assembler: Assembler | None = None
        self._readers: dict[str, RowReader] = {}
        self._clock = ''
        self._rows: dict[str, Row] = {}
        self._truth: list[tuple[int, Array]] = []
        self._tracks: dict[str, Track] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the topics that `take` takes, of this run."""
        return tuple(self._readers)

    @property
    def has_state(self) -> bool:
        """Return whether there is anything to see yet."""
        return self._clock in self._rows

    @property
    def has_truth(self) -> bool:
        """Return whether somebody tells where obstacles truly are."""
        return bool(self._truth)

    def take_scenario(self, text: str) -> None:
        """Take the latched scenario of a run; what was heard of another run is forgotten."""
        try:
            scenario = from_json(text)
            self._assembler = Assembler(scenario)
        except (LayeredCbfError, json.JSONDecodeError):
            self.rejected += 1
            return
        self.scenario = scenario
        self.runs += 1
        self._rows, self._truth, self._tracks = {}, [], {}
        self._readers = row_readers(scenario)
        self._clock = state_topic(scenario.robots[0])

    def take(self, topic: str, data: bytes) -> None:
        """Take one message that comes as named numbers, CDR bytes; a bad one is counted."""
        try:
            row = self._readers[topic].newest(data)
        except LayeredCbfError:
            self.rejected += 1
            return
        if row is not None:
            self._rows[topic] = row

    def take_truth(self, stamp_ns: int, positions: Array) -> None:
        """Take where the obstacles truly are [m], (n, 2)."""
        if not self._truth or stamp_ns != self._truth[-1][0]:
            self._truth = [*self._truth[-1:], (stamp_ns, positions)]

    def take_track(self, track: Track) -> None:
        """Take one track."""
        self._tracks[track.name] = track

    def take_diagnostics(self, message: Any, now: float) -> None:
        """Take a DiagnosticArray that came at a wall time [s]."""
        for sight in node_sights(message):
            self._nodes[sight.name] = sight, now

    def snapshot(self, now: float) -> Snapshot:
        """Return what is to be seen.

        Args:
            now: Wall time [s].
        """
        nodes = heard_nodes(self._nodes, now)
        if self._assembler is None or not self.has_state:
            return Snapshot(0, nodes=nodes)
        simulator = self._nodes.get(SIMULATOR)
        is_paused = simulator is not None and simulator[0].values.get('paused') == 'true'
        stamp_ns = self._rows[self._clock].stamp_ns
        return self._assembler.snapshot(stamp_ns, self._rows, self._obstacles(), nodes, is_paused)

    def _obstacles(self) -> tuple[ObstacleSight, ...]:
        if not self._truth or self.scenario is None:
            newest = max((track.stamp_ns for track in self._tracks.values()), default=0)
            return tracked_obstacles([t for t in self._tracks.values() if t.stamp_ns == newest])
        (earlier_ns, earlier), (later_ns, later) = self._truth[0], self._truth[-1]
        velocities = velocities_between((earlier_ns, later_ns), earlier, later)
        return true_obstacles(self.scenario.obstacles, later, velocities)
