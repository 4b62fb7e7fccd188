"""What a bag tells of a run, as numpy arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.base_states import Odometries, base_states, is_odometry
from layered_cbf_ros.bags.run.joined_states import is_robot_state, joined_states
from layered_cbf_ros.bags.run.motions import ObstacleMotion, RobotMotion, robot_motions
from layered_cbf_ros.bags.run.node_health import NodeHealth, SolveTimes
from layered_cbf_ros.bags.run.series import (
    JointStates,
    JointTrajectories,
    PlannedMotions,
    Series,
    SeriesBuilder,
)
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.node_topics import (
    BARRIERS,
    CLEARANCE,
    COMMANDS,
    DIAGNOSTICS,
    INTERVENTION,
    PLAN,
    SCENARIO,
    STATE,
    TRUTH,
)
from layered_cbf_ros.scenario import A1, BASES, Scenario
from layered_cbf_ros.scenario_file import from_json


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
        state, plan, clearance, barriers, intervention, commands: The topics of these
            names, or None where the bag has no message; of bases, the state is put
            together from their odometry, of real A1s from the topic of each.
        motions: Motion of each robot in /state, in its order.
        obstacles: Their true motion, or None.
        counters: Sum of each counter over the life of a node and its restarts,
            by node.
        diagnostics: The last key-values, by node.
        solve_times: How long each node computed that told it.
        notes: The recorder's own notes, see Bag.notes.
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
    commands: Series | None
    obstacles: ObstacleMotion | None
    counters: Mapping[str, Mapping[str, int]]
    diagnostics: Mapping[str, Mapping[str, str]]
    solve_times: Mapping[str, SolveTimes]
    notes: Mapping[str, Mapping[str, str]]

    @property
    def start_ns(self) -> int:
        """Stamp of the first state, from which times are counted [ns]; 0 without one."""
        return 0 if self.state is None else int(self.state.stamps_ns[0])

    def seconds(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Return stamps as seconds since the first state [s]."""
        return (stamps_ns - self.start_ns) / NS_PER_S


class RunGatherer:
    """Takes the messages of one bag that tell of the run; all others it doesn't need."""

    def __init__(self) -> None:
        self._series: dict[str, SeriesBuilder] = {
            STATE: JointStates(),
            CLEARANCE: JointStates(),
            PLAN: PlannedMotions(),
            BARRIERS: JointTrajectories(),
            INTERVENTION: JointTrajectories(),
            COMMANDS: JointTrajectories(),
        }
        self._topics = frozenset((*self._series, TRUTH, SCENARIO, DIAGNOSTICS))
        self._parts: dict[str, SeriesBuilder] = {}
        self._health = NodeHealth()
        self._scenario: Scenario | None = None
        self._unreadable: dict[str, int] = {}
        self._wall_spans_ns: dict[bool, tuple[int, int]] = {}
        self._state_ns: int | None = None
        self._decoder = MessageDecoder()
        self._obstacles: dict[int, Array] = {}

    def wants(self, topic: str) -> bool:
        """Tell whether a topic tells of the run."""
        return topic in self._topics or is_odometry(topic) or is_robot_state(topic)

    def take(self, record: Record) -> None:
        """Take one message that it wants; count it if it can't be decoded."""
        topic = record.topic.name
        is_part = is_odometry(topic) or is_robot_state(topic)
        if topic == STATE or is_part:
            first_ns, _ = self._wall_spans_ns.get(is_part, (record.log_time_ns, 0))
            self._wall_spans_ns[is_part] = first_ns, record.log_time_ns
        try:
            if is_part:
                kind = Odometries if is_odometry(topic) else JointStates
                self._parts.setdefault(topic, kind()).add(record.data)
                if False not in self._wall_spans_ns:
                    self._state_ns = stamp_of(record.data)
            elif topic in self._series:
                self._series[topic].add(record.data)
                if topic == STATE:
                    self._state_ns = stamp_of(record.data)
            else:
                self._take_other(topic, self._decoder.decode(record))
        except (LayeredCbfError, json.JSONDecodeError):
            self._unreadable[topic] = self._unreadable.get(topic, 0) + 1

    def finish(self, path: Path, bag: Bag) -> RunRecord:
        """Return all that was gathered in a pass through a bag.

        Args:
            path: What was asked for.
            bag: The bag, after the pass.
        """
        built = {topic: builder.build() for topic, builder in self._series.items()}
        if self._scenario is not None and self._scenario.plant in (BASES, A1):
            told = {topic: builder.build() for topic, builder in self._parts.items()}
            known = {topic: series for topic, series in told.items() if series is not None}
            join = base_states if self._scenario.plant == BASES else joined_states
            built[STATE] = join(known, self._scenario)
        return RunRecord(
            path=path,
            counts=bag.counts,
            truncated=bag.truncated,
            wall_span_ns=next(
                (self._wall_spans_ns[k] for k in sorted(self._wall_spans_ns)), (0, 0)
            ),
            unreadable=self._unreadable,
            scenario=self._scenario,
            state=built[STATE],
            motions=robot_motions(built[STATE]),
            plan=built[PLAN],
            clearance=built[CLEARANCE],
            barriers=built[BARRIERS],
            intervention=built[INTERVENTION],
            commands=built[COMMANDS],
            obstacles=self._obstacle_motion(),
            counters=self._health.totals(),
            diagnostics=self._health.last,
            solve_times=self._health.solve_times(),
            notes=dict(bag.notes),
        )

    def _obstacle_motion(self) -> ObstacleMotion | None:
        """Return the true motion of the obstacles, if there are any."""
        most = max((len(row) for row in self._obstacles.values()), default=0)
        stamps = sorted(stamp for stamp, row in self._obstacles.items() if len(row) == most)
        if not most:
            return None
        positions = np.stack([self._obstacles[stamp] for stamp in stamps])
        return ObstacleMotion(np.array(stamps, dtype=np.int64), positions)

    def _take_other(self, topic: str, message: Any) -> None:
        if topic == SCENARIO:
            self._scenario = from_json(message.data)
        elif topic == DIAGNOSTICS:
            self._health.add(message, self._state_ns)
        elif topic == TRUTH:
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
    bag, gatherer = open_bag(path), RunGatherer()
    for record in bag.records({name for name in bag.topics if gatherer.wants(name)}):
        gatherer.take(record)
    return gatherer.finish(path, bag)
