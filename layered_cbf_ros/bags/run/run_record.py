"""What a bag tells of a run, as numpy arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.series import (
    JointStates,
    JointTrajectories,
    PlannedMotions,
    Series,
    SeriesBuilder,
)
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.robot_state import FEET, JOINTS, VELOCITIES, state_names
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import from_json

STATE, PLAN = '/state', '/safe_trajectory'
CLEARANCE, OBSTACLES = '/simulator/clearance', '/obstacles/truth'
BARRIERS, INTERVENTION = '/coordinator/barriers', '/coordinator/intervention'
SCENARIO, DIAGNOSTICS = '/scenario', '/diagnostics'
COUNTERS = ('solver_failures', 'slack_events', 'deadline_misses', 'rejected')
POSITION, VELOCITY, EFFORT = range(3)


@dataclass(frozen=True, slots=True)
class RobotMotion:
    """How one robot moved; every row belongs to one stamp of /state.

    Attributes:
        stamps_ns: Stamps [ns], (k,).
        configurations, velocities: As in RobotState, (k, 19) and (k, 18).
        torques: Joint torques [Nm], (k, 12).
        foot_forces: Normal force on each foot [N], (k, 4).
    """

    stamps_ns: NDArray[np.int64]
    configurations: Array
    velocities: Array
    torques: Array
    foot_forces: Array


@dataclass(frozen=True, slots=True)
class ObstacleMotion:
    """Where the obstacles truly were, in the scenario's order.

    Attributes:
        stamps_ns: Stamps [ns], (k,).
        positions: Centres in the world plane [m], (k, n, 2).
    """

    stamps_ns: NDArray[np.int64]
    positions: Array


@dataclass(frozen=True)
class RunRecord:
    """One run.

    Attributes:
        path: The bag.
        counts: Messages by topic.
        truncated: True if the bag ends before its end.
        wall_span_ns: When the first and the last state were recorded [ns].
        unreadable: Messages that couldn't be decoded, by topic.
        scenario: What was run, or None if the bag doesn't tell.
        state, plan, clearance, barriers, intervention: The topics of these
            names, or None where the bag has no message.
        motions: Motion of each robot in /state, in its order.
        obstacles: Their true motion, or None.
        counters: Sum of each counter over the life of a node and its restarts,
            by node.
        diagnostics: The last key-values, by node.
    """

    path: Path
    counts: Mapping[str, int]
    truncated: bool
    wall_span_ns: tuple[int, int]
    unreadable: Mapping[str, int]
    scenario: Scenario | None
    state: Series | None
    motions: Mapping[str, RobotMotion]
    plan: Series | None
    clearance: Series | None
    barriers: Series | None
    intervention: Series | None
    obstacles: ObstacleMotion | None
    counters: Mapping[str, Mapping[str, int]]
    diagnostics: Mapping[str, Mapping[str, str]]

    @property
    def start_ns(self) -> int:
        """Stamp of the first state, from which times are counted [ns]; 0 without one."""
        return 0 if self.state is None else int(self.state.stamps_ns[0])

    def seconds(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Return stamps as seconds since the first state [s]."""
        return (stamps_ns - self.start_ns) / NS_PER_S


@dataclass
class _Diagnostics:
    """Gathers /diagnostics; a counter that falls back tells of a restart."""

    last: dict[str, dict[str, str]] = field(default_factory=dict)
    before_restart: dict[str, dict[str, int]] = field(default_factory=dict)

    def add(self, message: Any) -> None:
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            lost = self.before_restart.setdefault(status.name, dict.fromkeys(COUNTERS, 0))
            previous = self.last.get(status.name, {})
            for key in COUNTERS:
                if _count(values, key) < _count(previous, key):
                    lost[key] += _count(previous, key)
            self.last[status.name] = values

    def totals(self) -> dict[str, dict[str, int]]:
        return {
            node: {key: lost[key] + _count(self.last[node], key) for key in COUNTERS}
            for node, lost in self.before_restart.items()
        }


class _Loader:
    """Takes the messages of one bag, topic by topic."""

    def __init__(self) -> None:
        self.series: dict[str, SeriesBuilder] = {
            STATE: JointStates(),
            CLEARANCE: JointStates(),
            PLAN: PlannedMotions(),
            BARRIERS: JointTrajectories(),
            INTERVENTION: JointTrajectories(),
        }
        self.diagnostics = _Diagnostics()
        self.scenario: Scenario | None = None
        self.unreadable: dict[str, int] = {}
        self.wall_span_ns = (0, 0)
        self._decoder = MessageDecoder()
        self._obstacles: dict[int, Array] = {}

    def take(self, record: Record) -> None:
        """Take one message; count it if it can't be decoded."""
        topic = record.topic.name
        if topic == STATE:
            first_ns, _ = self.wall_span_ns
            self.wall_span_ns = (first_ns or record.log_time_ns, record.log_time_ns)
        try:
            if topic in self.series:
                self.series[topic].add(record.data)
            else:
                self._take_other(topic, self._decoder.decode(record))
        except (LayeredCbfError, json.JSONDecodeError):
            self.unreadable[topic] = self.unreadable.get(topic, 0) + 1

    def obstacles(self) -> ObstacleMotion | None:
        """Return the true motion of the obstacles, if there are any."""
        most = max((len(row) for row in self._obstacles.values()), default=0)
        stamps = sorted(stamp for stamp, row in self._obstacles.items() if len(row) == most)
        if not most:
            return None
        positions = np.stack([self._obstacles[stamp] for stamp in stamps])
        return ObstacleMotion(np.array(stamps, dtype=np.int64), positions)

    def _take_other(self, topic: str, message: Any) -> None:
        if topic == SCENARIO:
            self.scenario = from_json(message.data)
        elif topic == DIAGNOSTICS:
            self.diagnostics.add(message)
        elif topic == OBSTACLES:
            stamp = message.header.stamp
            row = [(pose.position.x, pose.position.y) for pose in message.poses]
            self._obstacles[stamp.sec * NS_PER_S + stamp.nanosec] = np.reshape(row, (-1, 2))


def load_run(path: Path) -> RunRecord:
    """Read a bag.

    Args:
        path: An mcap file, a bag's folder or a run's folder.

    Raises:
        BagError: If there is no bag.
    """
    reader, loader = open_bag(path), _Loader()
    for record in reader.records({*loader.series, OBSTACLES, SCENARIO, DIAGNOSTICS}):
        loader.take(record)
    built = {topic: builder.build() for topic, builder in loader.series.items()}
    return RunRecord(
        path=path,
        counts=reader.counts,
        truncated=reader.truncated,
        wall_span_ns=loader.wall_span_ns,
        unreadable=loader.unreadable,
        scenario=loader.scenario,
        state=built[STATE],
        motions=_motions(built[STATE]),
        plan=built[PLAN],
        clearance=built[CLEARANCE],
        barriers=built[BARRIERS],
        intervention=built[INTERVENTION],
        obstacles=loader.obstacles(),
        counters=loader.diagnostics.totals(),
        diagnostics=loader.diagnostics.last,
    )


def _motions(state: Series | None) -> dict[str, RobotMotion]:
    """Return the motion of each robot that has a base in /state."""
    if state is None:
        return {}
    names = [name.split('/')[0] for name in state.names if name.endswith('/base_x')]
    motions = {}
    for name in names:
        values = state.values[:, :, state.columns(state_names(name))]
        motions[name] = RobotMotion(
            state.stamps_ns,
            values[:, POSITION, : JOINTS.stop],
            values[:, VELOCITY][:, VELOCITIES],
            values[:, EFFORT, JOINTS],
            values[:, EFFORT, FEET],
        )
    return motions


def _count(values: Mapping[str, str], key: str) -> int:
    """Return a counter of a diagnostic status; 0 where it is absent or no number."""
    text = values.get(key, '0')
    return int(text) if text.isdigit() else 0
