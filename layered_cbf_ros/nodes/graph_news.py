"""What the supervisor hears from the graph."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.node_topics import DIAGNOSTICS
from layered_cbf_ros.nodes.diagnostics import DiagnosticsPublisher, report_of
from layered_cbf_ros.nodes.transport import Reader, decoded, latched
from layered_cbf_ros.run_nodes import FINISHED, PLANTS
from layered_cbf_ros.supervision.status import Heard, is_told_of, silent_nodes
from layered_cbf_ros.supervision.supervisor import News

MANY = 100  # nodes whose latched word is kept


class GraphNews(Node):
    """Hears who is ready, how the nodes fare, and the simulated time.

    Attributes:
        heard: Last diagnostics, by node, as it told them itself.
        diagnostics: Tells how the supervisor fares, and who can't tell any more.
        wall_time: From the first to the last step of the simulated time, without pauses [s].
    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__('supervisor', start_parameter_services=False)
        self._names = names
        self._ready_reader = Reader(self, String, '/ready', latched(MANY))
        self._diagnostics_reader = Reader(self, DiagnosticArray, DIAGNOSTICS)
        self._clock_reader = Reader(self, Clock, '/clock')
        self._ready: set[str] = set()
        self._simulated: float | None = None
        self._stepped = 0.0
        self._paused = False
        self.heard: dict[str, Heard] = {}
        self.diagnostics = DiagnosticsPublisher(self)
        self.wall_time = 0.0

    def listen(self, now: float) -> News:
        """Take all that has come since the last call; return what is known.

        Args:
            now: Wall time [s].
        """
        while (data := self._ready_reader.take()) is not None:
            with contextlib.suppress(MessageError):
                self._ready.add(decoded(data, String).data)
        while (data := self._diagnostics_reader.take()) is not None:
            with contextlib.suppress(MessageError):
                for status in decoded(data, DiagnosticArray).status:
                    report = report_of(status)
                    if not is_told_of(report):
                        self.heard[status.name] = Heard(report, now)
        while (data := self._clock_reader.take()) is not None:
            if self._simulated is not None and not self._paused:
                self.wall_time += now - self._stepped
            with contextlib.suppress(MessageError):
                self._simulated = stamp_of(data) / NS_PER_S
            self._stepped = now
        silent = silent_nodes(self._names, self.heard, now)
        plants = [self.heard[name] for name in PLANTS if name in self.heard and name not in silent]
        self._paused = any(plant.report.values.get('paused') == 'true' for plant in plants)
        finished = any(plant.report.values.get('state') == FINISHED for plant in plants)
        return News(frozenset(self._ready), self._simulated, tuple(silent), self._paused, finished)
