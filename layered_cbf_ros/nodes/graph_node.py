"""What every node of the graph does: be ready, tick on states, fetch inputs, tell its health."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

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
from layered_cbf_ros.node_topics import STATE
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.diagnostics import DiagnosticsPublisher
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
        self.statistics.real_time = not self.lockstep
        self.readers: list[Reader] = []
        self.writers: list[Writer] = []
        self._ready = self.create_publisher(String, '/ready', latched())
        self._diagnostics = DiagnosticsPublisher(self, self.statistics)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        self._next_service_ns = 0
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

    def accept(self, decode: Callable[[A], T], data: A, topic: str = '') -> T | None:
        """Return the decoded message, or count and name it if it is refused.

        Args:
            decode: Returns it, or raises MessageError.
            data: What came.
            topic: Where it came from, if the error doesn't say it.
        """
        try:
            return decode(data)
        except MessageError as error:
            self.statistics.reject(f'{topic}: {error}' if topic else str(error))
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
            self.statistics.wait_for(', '.join(missing), time.monotonic_ns())
            self.serve()
            time.sleep(0.01)
        self.statistics.waiting_for = ''
        self.tell_ready()

    def tell_ready(self) -> None:
        """Tell everybody, also those who come later."""
        self.statistics.state = 'running'
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
        self.statistics.period_ns = every_ns
        while True:
            data = reader.take()
            if data is None:
                self.wait(reader, None, '')
                continue
            if self.accept(inbox.offer, data, reader.topic) is False:
                self.resend()
            while (due := inbox.exactly(wanted)) is not None:
                self.statistics.begin(time.monotonic_ns(), wanted)
                yield due
                self.serve()
                wanted += every_ns

    def _newest(self, reader: Reader, every_ns: int) -> Iterator[bytes]:
        guard, last_ns = StampGuard(), None
        self.statistics.period_ns = round(every_ns / self.timing.pace)
        while True:
            self.serve()
            data = reader.take()
            if data is None:
                self.wait(reader, None, '')
                continue
            while (newer := reader.take()) is not None:
                data = newer
            stamp_ns = self.accept(guard.check, data, reader.topic)
            if stamp_ns is None:
                continue
            if last_ns is not None:
                if stamp_ns - last_ns < every_ns:
                    continue
                self.statistics.deadline_misses += (stamp_ns - last_ns) // every_ns - 1
            last_ns = stamp_ns
            self.statistics.begin(time.monotonic_ns(), stamp_ns)
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
        if silent:
            self.statistics.wait_for(sender or reader.topic, now_ns, idle=not sender)
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

    def serve(self, at_once: bool = False) -> None:
        """Answer services, when it is time to or at once, and tell once a second how it fares.

        Raises:
            StopRequestedError: If the node was asked to end.
        """
        if self.stop_requested:
            raise StopRequestedError
        now_ns = time.monotonic_ns()
        self._diagnostics.serve(now_ns)
        if now_ns >= self._next_service_ns or at_once:
            self._next_service_ns = now_ns + SERVICE_PERIOD_NS
            self._executor.spin_once(timeout_sec=0.0)

    def publish_diagnostics(self, state: str) -> None:
        """Tell now, and not only with the next second, that the node does something else.

        Args:
            state: What it does from now on: 'running', 'paused' or 'finished'.
        """
        self.statistics.state = state
        self._diagnostics.publish(time.monotonic_ns())

    def close(self) -> None:
        """Tell the last figures, and see them delivered."""
        self._diagnostics.close()
        for writer in self.writers:
            writer.see_delivered()

    def run(self) -> None:
        """Tick until asked to end."""
        raise NotImplementedError

    def _request_stop(self, number: int, frame: object) -> None:
        self.stop_requested = True
