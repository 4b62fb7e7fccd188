"""The states of robots that each have a topic of their own: estimated, or from far away."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence

import numpy as np
from sensor_msgs.msg import JointState

from layered_cbf_ros.coordination.coordination_layer import CoordinationLayer
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S, RobotState, Track
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.node_topics import robot_state
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.operation.orders import Orders
from layered_cbf_ros.run_clock import RunClock
from layered_cbf_ros.timing import Inbox

LOST_NS = NS_PER_S // 5
"""Silence after which a robot counts as one that doesn't answer [ns]."""
LATE_NS = NS_PER_S // 10
"""Beyond this the schedule of ticks starts anew [ns]."""


class WiredStates:
    """Collects the states of all robots for each tick; the plan is all they are told.

    In lockstep a tick has exactly the states of its stamp. In real time ticks come by
    absolute deadlines of the run's clock, from when the first robot was heard, and take
    the newest states. Of one that is silent, nothing is known but that it doesn't answer:
    its plan stops, and the others keep clear of it.
    """

    def __init__(self, node: GraphNode, robots: Sequence[str]) -> None:
        """Subscribe."""
        self._node, self._names = node, robots
        self._readers = [node.reader(JointState, robot_state(name)) for name in robots]
        self._decoders = [StateReader(name) for name in robots]
        self._states: list[RobotState | None] = [None] * len(robots)
        self._newest: list[RobotState | None] = [None] * len(robots)
        self._stamp_ns = 0

    @property
    def unknown(self) -> int:
        """Return of how many robots nothing is known at this tick."""
        return self._states.count(None)

    def ticks(self) -> Iterator[int]:
        """Yield the stamp of each tick [ns]."""
        self._node.become_ready()
        timing = self._node.timing
        self._node.statistics.period_ns = round(timing.tick_ns / timing.pace)
        for stamp_ns in self._exact() if self._node.lockstep else self._timed():
            self._stamp_ns = stamp_ns
            yield stamp_ns

    def inputs(
        self, layer: CoordinationLayer, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs:
        """Return what the coordinator is told at this tick."""
        told = layer.inputs(self._stamp_ns, self._states, tracks, orders.commands, orders.stopped)
        if not self.unknown:
            return told
        silent = np.array([state is None for state in self._states])
        return dataclasses.replace(told, fallen=told.fallen | silent)

    def answer(self, result: CoordinationResult) -> None:
        """Do nothing."""

    def _exact(self) -> Iterator[int]:
        inboxes, wanted = [Inbox() for _ in self._names], 0
        while True:
            received = [self._wait_for(k, inboxes[k], wanted) for k in range(len(self._names))]
            self._node.statistics.begin(time.monotonic_ns(), wanted)
            self._states = [
                self._node.accept(decoder.read, data)
                for decoder, data in zip(self._decoders, received, strict=True)
            ]
            yield wanted
            self._node.serve()
            wanted += self._node.timing.tick_ns

    def _wait_for(self, robot: int, inbox: Inbox, stamp_ns: int) -> bytes:
        """Wait for a robot's state of a stamp; who sends again what is known missed an answer."""
        node, reader = self._node, self._readers[robot]
        while (found := inbox.exactly(stamp_ns)) is None:
            data = reader.take()
            if data is None:
                node.wait(reader, None, '')
            elif node.accept(inbox.offer, data) is False:
                node.resend()
        return found

    def _timed(self) -> Iterator[int]:
        clock, period_ns = RunClock(self._node.timing), self._node.timing.tick_ns
        due_ns = -1
        while True:
            self._node.serve()
            now_ns = clock.now_ns()
            late_ns = now_ns - due_ns
            if due_ns < 0 or late_ns > LATE_NS:
                self._node.statistics.deadline_misses += due_ns >= 0
                due_ns = now_ns // period_ns * period_ns
            else:
                self._node.statistics.deadline_misses += late_ns > period_ns
                clock.sleep_until(due_ns)
            self._states = [self._known(robot, due_ns) for robot in range(len(self._names))]
            if self.unknown < len(self._names):
                self._node.statistics.begin(time.monotonic_ns(), due_ns)
                yield due_ns
            due_ns += period_ns

    def _known(self, robot: int, now_ns: int) -> RobotState | None:
        """Return the newest state of a robot, None if it is old."""
        newest = None
        while (data := self._readers[robot].take()) is not None:
            newest = data
        if newest is not None:
            self._node.accept(lambda data: self._hear(robot, data, now_ns), newest)
        state = self._newest[robot]
        return state if state is not None and now_ns - state.stamp_ns <= LOST_NS else None

    def _hear(self, robot: int, data: bytes, now_ns: int) -> None:
        """Take a state.

        Raises:
            MessageError: If it is malformed, older than one before, or from another time.
        """
        state, newest = self._decoders[robot].read(data), self._newest[robot]
        ahead = (state.stamp_ns - now_ns) / NS_PER_S
        if abs(state.stamp_ns - now_ns) > LOST_NS:
            raise MessageError(
                f"state of '{self._names[robot]}' has a stamp {abs(ahead):.3f} s "
                f'{"ahead" if ahead > 0.0 else "ago"}; let the clocks of all computers agree'
            )
        if newest is not None and state.stamp_ns < newest.stamp_ns:
            raise MessageError(f"state of '{self._names[robot]}' is older than the one before")
        self._newest[robot] = state
