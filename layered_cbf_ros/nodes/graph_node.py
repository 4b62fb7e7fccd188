"""What every node of the graph does: be ready, tick on states, fetch inputs, tell its health."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from layered_cbf_ros.errors import (
    MessageError,
    MissingInputError,
    ParameterError,
    StopRequestedError,
)
from layered_cbf_ros.loop_statistics import LoopStatistics
from layered_cbf_ros.node_topics import DIAGNOSTICS, STATE
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.transport import (
    RELIABLE_DEPTH,
    RESEND_DEPTH,
    Reader,
    Writer,
    latched,
    reliable,
)
from layered_cbf_ros.timing import (
    LOCKSTEP,
    Inbox,
    InputRules,
    StampGuard,
    TimingParameters,
)

A = TypeVar('A')
T = TypeVar('T')
SLICE_S = 0.05  # longest uninterrupted wait: how fast signals and services are answered
SILENT_SLICES = 3  # after so many a message counts as lost
SERVICE_PERIOD_NS = 500_000_000
DIAGNOSTIC_PERIOD_NS = 1_000_000_000
DELIVERY_S = 0.5


class GraphNode(Node):
    """Base of the nodes that tick on states."""

    exit_code = 0  # of a node that was asked to end

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.timing = declare(self, TimingParameters)
        self.rules = InputRules(self.timing)
        self.lockstep = self.timing.time == LOCKSTEP
        self.scenario = str(self.declare_parameter('scenario', '').value)
        self.recorded = bool(self.declare_parameter('recorded', False).value)
        self.state_topic = str(self.declare_parameter('state_topic', STATE).value)
        self.stop_requested = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._request_stop)
        self.statistics = LoopStatistics()
        self.readers: list[Reader] = []
        self.writers: list[Writer] = []
        self._ready = self.create_publisher(String, '/ready', latched())
        self._diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        self._next_service_ns = self._next_diagnostic_ns = 0
        self._silent_slices = 0

    def reader(self, message_type: type, topic: str, depth: int = RELIABLE_DEPTH) -> Reader:
        """Subscribe to a topic of the control path."""
        self.readers.append(Reader(self, message_type, topic, reliable(depth)))
        return self.readers[-1]

    def writer(
        self, message_type: type, topic: str, expected_readers: int = 1, kept: int = RESEND_DEPTH
    ) -> Writer:
        """Publish a topic of the control path, to at least so many readers.

        Args:
            message_type, topic: What.
            expected_readers: How many there must be in lockstep, but for the recorder.
            kept: How many messages can be sent again.
        """
        expected = expected_readers + self.recorded
        self.writers.append(Writer(self, message_type, topic, expected, kept))
        return self.writers[-1]

    def accept(self, decode: Callable[[A], T], data: A) -> T | None:
        """Return the decoded message, or count and name it if it is refused."""
        try:
            return decode(data)
        except MessageError as error:
            self.statistics.reject(str(error))
            return None

    def refuse_unknown_parameters(self) -> None:
        """Make sure that every parameter that was given is known.

        Raises:
            ParameterError: Naming the first that isn't.
        """
        for name in self._parameter_overrides:
            if not self.has_parameter(name):
                node = self.get_name()
                raise ParameterError(f"{node}: unknown parameter '{name}'; see {node} --help")

    def become_ready(self) -> None:
        """Wait, in lockstep, until every topic has its partners; then tell."""
        while self.lockstep:
            missing = [r.topic for r in self.readers if not r.publishers]
            missing += [w.topic for w in self.writers if w.readers < w.expected_readers]
            if not missing:
                break
            self.statistics.waiting_for = ', '.join(missing)
            self.serve()
            time.sleep(0.01)
        self.statistics.waiting_for = ''
        self.tell_ready()

    def tell_ready(self) -> None:
        """Tell everybody, also those who come later."""
        self._ready.publish(String(data=self.get_fully_qualified_name()))

    def ticks(self, every_ns: int) -> Iterator[bytes]:
        """Yield state messages: each one in lockstep, the newest in real time.

        Args:
            every_ns: Period of this node's ticks [ns].
        """
        reader = self.reader(JointState, self.state_topic)
        self.become_ready()
        return self.each(reader, every_ns) if self.lockstep else self._newest(reader, every_ns)

    def each(self, reader: Reader, every_ns: int) -> Iterator[bytes]:
        """Yield the messages of stamps 0, every_ns, ..., none left out, in order."""
        inbox, wanted = Inbox(), 0
        while True:
            data = reader.take()
            if data is None:
                self.wait(reader, None, '')
                continue
            if self.accept(inbox.offer, data) is False:
                self.resend()
            while (due := inbox.exactly(wanted)) is not None:
                yield due
                self.serve()
                wanted += every_ns

    def _newest(self, reader: Reader, every_ns: int) -> Iterator[bytes]:
        guard, last_ns = StampGuard(), None
        while True:
            self.serve()
            data = reader.take()
            if data is None:
                self.wait(reader, None, '')
                continue
            while (newer := reader.take()) is not None:
                data = newer
            stamp_ns = self.accept(guard.check, data)
            if stamp_ns is None:
                continue
            if last_ns is not None:
                if stamp_ns - last_ns < every_ns:
                    continue
                self.statistics.deadline_misses += (stamp_ns - last_ns) // every_ns - 1
            last_ns = stamp_ns
            yield data

    def wait(self, reader: Reader, give_up_ns: int | None, sender: str) -> None:
        """Wait for a message a while, serving everything else.

        Raises:
            MissingInputError: If the wall time to give up has come.
            StopRequestedError: If the node was asked to end.
        """
        self.serve()
        begun_ns = time.monotonic_ns()
        reader.wait(SLICE_S)
        now_ns = time.monotonic_ns()
        silent = now_ns - begun_ns >= round(SLICE_S * 1e9)
        self._silent_slices = self._silent_slices + 1 if silent else 0
        if self._silent_slices == SILENT_SLICES:
            self._silent_slices = 0
            self.on_silence()
        if give_up_ns is not None and now_ns > give_up_ns:
            raise MissingInputError(f'MISSING {sender}: nothing on {reader.topic}')

    def begin_wait(self) -> int:
        """Begin to wait in lockstep; return the wall time at which to give up [ns]."""
        self._silent_slices = 0
        return time.monotonic_ns() + round(self.timing.patience * 1e9)

    def on_silence(self) -> None:
        """Do nothing: only who keeps the time asks again for what may be lost."""

    def resend(self) -> None:
        """Send the last messages again: somebody seems to have lost one."""
        for writer in self.writers:
            if writer.expected_readers > self.recorded:
                writer.resend(time.monotonic_ns())

    def serve(self) -> None:
        """Answer services and publish diagnostics, when it is time to.

        Raises:
            StopRequestedError: If the node was asked to end.
        """
        if self.stop_requested:
            raise StopRequestedError
        now_ns = time.monotonic_ns()
        if now_ns < self._next_service_ns:
            return
        self._next_service_ns = now_ns + SERVICE_PERIOD_NS
        self._executor.spin_once(timeout_sec=0.0)
        if now_ns >= self._next_diagnostic_ns:
            self._next_diagnostic_ns = now_ns + DIAGNOSTIC_PERIOD_NS
            self.publish_diagnostics('running')

    def publish_diagnostics(self, state: str) -> None:
        """Tell what the node counted."""
        figures = self.statistics.report(time.monotonic_ns())
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if self.is_well else DiagnosticStatus.WARN,
            name=self.get_fully_qualified_name(),
            message=figures['last_rejected'] or state,
            values=[KeyValue(key='state', value=state)]
            + [KeyValue(key=key, value=value) for key, value in figures.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    @property
    def is_well(self) -> bool:
        """Return whether nothing happened that a person should know of."""
        return not (self.statistics.rejected or self.statistics.solver_failures)

    def close(self) -> None:
        """Tell the last figures, and see them delivered."""
        self.publish_diagnostics('ended')
        self._diagnostics.wait_for_all_acked(Duration(seconds=DELIVERY_S))
        for writer in self.writers:
            writer.see_delivered()

    def run(self) -> None:
        """Tick until asked to end."""
        raise NotImplementedError

    def _request_stop(self, number: int, frame: object) -> None:
        self.stop_requested = True
