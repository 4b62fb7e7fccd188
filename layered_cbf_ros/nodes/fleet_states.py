"""What the coordinator hears from a fleet with its own locomotion, and what it answers."""

from __future__ import annotations

import time
from collections.abc import Iterator

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock

from layered_cbf_ros.coordination.coordination_layer import CoordinationLayer
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.coordination.fleet import Fleet
from layered_cbf_ros.coordination.fleet_parameters import FleetParameters
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S, BaseState, Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.odometry import OdometryReader, base_frame
from layered_cbf_ros.messages.twist import TwistWriter
from layered_cbf_ros.node_topics import cmd_vel_safe, odometry
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.transport import Reader
from layered_cbf_ros.operation.orders import Orders
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import Inbox

Bases = list[BaseState | None]


class FleetStates:
    """Collects the odometry of all bases for each tick, and sends them safe velocities.

    In lockstep a tick has exactly the odometry of its stamp, of all bases. In real time
    ticks come by absolute deadlines, with stamps of the node's clock, and take the newest
    odometry; a base that is silent, or whose messages are refused, is unknown.
    """

    def __init__(
        self,
        node: GraphNode,
        scenario: Scenario,
        parameters: FleetParameters,
        limits: CoordinatorParameters,
    ) -> None:
        """Subscribe and advertise.

        Args:
            node: The coordinator.
            scenario: Its bases.
            parameters: How they are followed.
            limits: Of their plans.
        """
        names = [robot.name for robot in scenario.robots]
        self._node = node
        self._names = names
        self._fleet = Fleet(scenario.robots, parameters, limits)
        self._age_limit_ns = round(parameters.odometry_age_limit * NS_PER_S)
        self._readers = [node.reader(Odometry, odometry(name)) for name in names]
        self._decoders = [OdometryReader(name, parameters.world_frame) for name in names]
        self._newest: Bases = [None] * len(names)
        self._stamp_ns, self._points = 0, self._newest
        self._writers = [node.writer(TwistStamped, cmd_vel_safe(name)) for name in names]
        self._encoders = [TwistWriter(base_frame(name)) for name in names]
        simulated = node.get_parameter('use_sim_time').value and not node.lockstep
        self._clock = Reader(node, Clock, '/clock') if simulated else None
        self._clock_ns = 0

    @property
    def unknown(self) -> int:
        """Return of how many bases nothing is known at this tick."""
        return self._points.count(None)

    def ticks(self) -> Iterator[int]:
        """Yield the stamp of each tick [ns]."""
        self._node.become_ready()
        for stamp_ns, bases in self._exact() if self._node.lockstep else self._timed():
            self._stamp_ns, self._points = stamp_ns, self._fleet.coordinated(bases)
            yield stamp_ns

    def inputs(
        self, layer: CoordinationLayer, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs:
        """Return what the coordinator is told at this tick."""
        return layer.inputs_of_bases(
            self._stamp_ns, self._points, tracks, orders.commands, orders.stopped
        )

    def answer(self, result: CoordinationResult) -> None:
        """Tell every base its safe velocity."""
        told = self._fleet.commands(result, self._points)
        for writer, encoder, velocity in zip(self._writers, self._encoders, told, strict=True):
            writer.publish(encoder.encode(self._stamp_ns, velocity))

    def _exact(self) -> Iterator[tuple[int, Bases]]:
        inboxes, wanted = [Inbox() for _ in self._names], 0
        while True:
            received = [self._wait_for(k, inboxes[k], wanted) for k in range(len(self._names))]
            bases = [
                self._node.accept(decoder.read, data)
                for decoder, data in zip(self._decoders, received, strict=True)
            ]
            yield wanted, bases
            self._node.serve()
            wanted += self._node.timing.tick_ns

    def _wait_for(self, robot: int, inbox: Inbox, stamp_ns: int) -> bytes:
        """Wait for a base's odometry of a stamp; who sends again what is known missed an answer."""
        node, reader = self._node, self._readers[robot]
        while (found := inbox.exactly(stamp_ns)) is None:
            data = reader.take()
            if data is None:
                node.wait(reader, None, '')
            elif node.accept(inbox.offer, data) is False:
                node.resend()
        return found

    def _timed(self) -> Iterator[tuple[int, Bases]]:
        period_ns, last_ns = self._node.timing.tick_ns, -1
        due_ns = time.monotonic_ns()
        while True:
            self._node.serve()
            due_ns = self._sleep_until(due_ns + period_ns)
            now_ns = self._now_ns()
            if now_ns <= last_ns:  # simulated time stands, or the clock was set back
                last_ns = now_ns if last_ns - now_ns > self._age_limit_ns else last_ns
                continue
            last_ns = now_ns
            yield now_ns, [self._known(robot, now_ns) for robot in range(len(self._names))]

    def _sleep_until(self, due_ns: int) -> int:
        """Sleep until a wall time; return it, or a later one after missed deadlines [ns]."""
        period_ns = self._node.timing.tick_ns
        left_ns = due_ns - time.monotonic_ns()
        if left_ns > 0:
            time.sleep(left_ns * 1e-9)
            return due_ns
        missed = -left_ns // period_ns
        self._node.statistics.deadline_misses += missed
        return due_ns + missed * period_ns

    def _now_ns(self) -> int:
        """Return the time of the node's clock [ns]; simulated time is taken by hand."""
        if self._clock is None:
            return int(self._node.get_clock().now().nanoseconds)
        while (data := self._clock.take()) is not None:
            self._clock_ns = self._node.accept(stamp_of, data) or self._clock_ns
        return self._clock_ns

    def _known(self, robot: int, now_ns: int) -> BaseState | None:
        """Return where a base is now, None if nothing of it is recent."""
        while (data := self._readers[robot].take()) is not None:
            self._node.accept(lambda bytes_: self._hear(robot, bytes_, now_ns), data)
        newest = self._newest[robot]
        if newest is None or abs(now_ns - newest.stamp_ns) > self._age_limit_ns:
            return None
        return newest.at(now_ns)

    def _hear(self, robot: int, data: bytes, now_ns: int) -> None:
        """Take an odometry message.

        Raises:
            MessageError: If it is bad, older than one before, or from another time.
        """
        state = self._decoders[robot].read(data)
        apart = (now_ns - state.stamp_ns) / NS_PER_S
        if abs(now_ns - state.stamp_ns) > self._age_limit_ns:
            raise MessageError(
                f"odometry of '{self._names[robot]}' has a stamp {abs(apart):.3f} s "
                f'{"ago" if apart > 0.0 else "ahead"}; send it at once, by the same clock'
            )
        newest = self._newest[robot]
        if newest is None or state.stamp_ns >= newest.stamp_ns:
            self._newest[robot] = state
