"""How a node tells on /diagnostics how it fares, and how that is read."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.node import Node

from layered_cbf_ros.health import Level, Report
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.loop_statistics import LoopStatistics
from layered_cbf_ros.node_topics import DIAGNOSTICS
from layered_cbf_ros.nodes.transport import reliable

PERIOD_NS = NS_PER_S
DELIVERY = Duration(seconds=0.5)
DEPTH = 10


class DiagnosticsPublisher:
    """Tells once a second of wall time how a node fares.

    Whoever loops calls `serve` in each turn, right after its work is sent: then there is
    most time until the next turn. It costs a comparison but for once a second; then one
    turn computes the figures and the next one sends them, a third of a millisecond each.

    Attributes:
        statistics: What the node counts, and what is wrong with it.
    """

    def __init__(self, node: Node, statistics: LoopStatistics | None = None) -> None:
        """Begin.

        Args:
            node: Who tells; its full name is the name of its status.
            statistics: What it counts, None for new ones.
        """
        self.statistics = statistics or LoopStatistics()
        self._node = node
        self._name = node.get_fully_qualified_name()
        self._hardware_id = node.get_namespace().strip('/') or socket.gethostname()
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, reliable(DEPTH))
        self._due_ns = 0
        self._report: Report | None = None

    def serve(self, now_ns: int) -> None:
        """Tell, if it is time to.

        Args:
            now_ns: Monotonic wall time [ns].
        """
        if self._report is not None:
            self._send((self._report,))
        if now_ns < self._due_ns:
            return
        late_ns = now_ns - self._due_ns
        self._due_ns = (now_ns if late_ns >= PERIOD_NS else self._due_ns) + PERIOD_NS
        self._report = self._reported(now_ns)

    def publish(self, now_ns: int, of_others: Sequence[Report] = ()) -> None:
        """Tell now.

        Args:
            now_ns: Monotonic wall time [ns].
            of_others: What is told of nodes that don't tell it themselves.
        """
        self._send((self._reported(now_ns), *of_others))

    def close(self) -> None:
        """Tell the last figures, and see them delivered."""
        self.statistics.state = 'ended'
        self.publish(time.monotonic_ns())
        self._publisher.wait_for_all_acked(DELIVERY)

    def _reported(self, now_ns: int) -> Report:
        level, message, values = self.statistics.report(now_ns)
        return Report(self._name, level, message, values, self._hardware_id)

    def _send(self, reports: Sequence[Report]) -> None:
        array = DiagnosticArray(status=[status_of(report) for report in reports])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
        self._report = None


def status_of(report: Report) -> DiagnosticStatus:
    """Return a report as a message."""
    return DiagnosticStatus(
        level=bytes([report.level]),
        name=report.name,
        message=report.message,
        hardware_id=report.hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )


def report_of(status: DiagnosticStatus) -> Report:
    """Return a message, of any node, as a report; an unknown level is an error."""
    level = status.level[0]
    return Report(
        status.name,
        Level(level) if level in tuple(Level) else Level.ERROR,
        status.message,
        {entry.key: entry.value for entry in status.values},
        status.hardware_id,
    )
