"""The listening side of `supervisor status`: hears /diagnostics, and disturbs nobody."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.health import Report
from layered_cbf_ros.node_topics import DIAGNOSTICS
from layered_cbf_ros.nodes.diagnostics import report_of
from layered_cbf_ros.nodes.transport import Reader, decoded, find_each_other_fast
from layered_cbf_ros.supervision.printer import Printer
from layered_cbf_ros.supervision.status import SUPERVISOR, Heard
from layered_cbf_ros.supervision.status_command import (
    StatusOptions,
    aged,
    exit_code,
    headline,
    members,
    nobody_on,
    status_json,
    summary_of,
)
from layered_cbf_ros.supervision.status_table import row_of, table_lines

LISTEN_S = 1.5  # everybody speaks once a second
QUIET_S = 3.0  # on a busy machine it takes so long until a process has found another
LATEST_S = 8.0
SLICE_S = 0.1
WATCH_S = 1.0
NAMELESS = ''


class StatusListener(Node):
    """Hears every node on /diagnostics, whoever started it."""

    def __init__(self) -> None:
        super().__init__(
            f'supervisor_status_{os.getpid()}',
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._reader = Reader(self, DiagnosticArray, DIAGNOSTICS)
        self._heard: dict[str, Heard] = {}

    def listen(self, duration: float) -> None:
        """Take all that comes for a while [s]."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            self._reader.wait(min(SLICE_S, left))
            while (data := self._reader.take()) is not None:
                with contextlib.suppress(MessageError):
                    for status in decoded(data, DiagnosticArray).status:
                        self._heard[status.name] = Heard(report_of(status), time.monotonic())

    def listen_to_all(self) -> None:
        """Listen until everybody who is there has spoken, or had the time to.

        A supervisor says who belongs to its run. Without one, all are taken to be there
        once nobody new has turned up for a while.
        """
        begun = changed = time.monotonic()
        known: set[str] = set()
        while True:
            self.listen(SLICE_S)
            now, found = time.monotonic(), self._there() | set(self._heard)
            if found != known:
                known, changed = found, now
            all_heard = now - begun > LISTEN_S and SUPERVISOR in self._heard and not self._unheard()
            if all_heard or now - changed > QUIET_S or now - begun > LATEST_S:
                return

    def reports(self) -> list[Report]:
        """Return what is known of each node now."""
        named = [name for name in self._unheard() if name != NAMELESS]
        return aged(self._heard, named, time.monotonic())

    def _unheard(self) -> list[str]:
        """Return the nodes that should or could tell something and did not."""
        return sorted((self._there() | members(self._heard)) - set(self._heard))

    def _there(self) -> set[str]:
        """Return the nodes that publish on /diagnostics, NAMELESS while some name is not known."""
        return {
            NAMELESS
            if endpoint.node_name.startswith('_')
            else f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
            for endpoint in self.get_publishers_info_by_topic(DIAGNOSTICS)
        }


def show_status(options: StatusOptions) -> int:
    """Print how all nodes fare, once or every second; return the exit code."""
    find_each_other_fast()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = StatusListener()
    printer = Printer(sys.stdout, sys.stdout.isatty() and options.watch)
    try:
        node.listen_to_all()
        while True:
            reports = node.reports()
            _show(reports, options, printer)
            if not options.watch:
                break
            node.listen(WATCH_S)
    except KeyboardInterrupt:
        reports = node.reports()
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return exit_code(reports)


def _show(reports: list[Report], options: StatusOptions, printer: Printer) -> None:
    terminal = sys.stdout.isatty()
    columns = shutil.get_terminal_size().columns if terminal else None
    nobody = nobody_on(os.environ.get('ROS_DOMAIN_ID') or '0')
    if not reports and not options.watch:
        print(f'ERROR {nobody}', file=sys.stderr)
    elif options.json:
        print(json.dumps(status_json(reports)), flush=True)
    elif not reports:
        printer.show([nobody[: columns and columns - 1]])
    else:
        table = table_lines([row_of(report) for report in reports], columns, terminal)
        printer.show([headline(summary_of(reports))[: columns and columns - 1], *table])
