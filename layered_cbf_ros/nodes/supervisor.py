"""supervisor: starts every node of a scenario, watches them, ends them, and judges the run."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from layered_cbf_ros.bags.command_line import run_verb
from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.health import Report
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.nodes.graph_news import GraphNews
from layered_cbf_ros.nodes.robot_orders import give_order
from layered_cbf_ros.nodes.status_listener import show_status
from layered_cbf_ros.nodes.transport import find_each_other_fast
from layered_cbf_ros.resources import find_folder
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import load_scenario, with_overrides
from layered_cbf_ros.supervision import shared_memory
from layered_cbf_ros.supervision.child import Child, node_command
from layered_cbf_ros.supervision.command_line import Options, parse
from layered_cbf_ros.supervision.domain_lock import DomainLock
from layered_cbf_ros.supervision.hosts import ALL, BASE, check_host
from layered_cbf_ros.supervision.order_command import ORDERS, parse_order
from layered_cbf_ros.supervision.printer import Printer, progress_line
from layered_cbf_ros.supervision.process_plan import (
    ProcessSpec,
    patience_of,
    process_plan,
    viewer_process,
)
from layered_cbf_ros.supervision.run_folder import RunFolder, make_run_folder
from layered_cbf_ros.supervision.run_parameters import with_joystick
from layered_cbf_ros.supervision.status import (
    faults_of_run,
    is_told_of,
    processor_shares,
    processor_time,
    reports_of_run,
)
from layered_cbf_ros.supervision.status_command import WORD, parse_status
from layered_cbf_ros.supervision.status_table import row_of
from layered_cbf_ros.supervision.supervisor import News, RunOutcome, Supervisor
from layered_cbf_ros.timing import REAL_TIME
from layered_cbf_ros.viewing.front.check import check_front

PERIOD_S = 0.05
STATUS_S = 1.0
EXIT_ERROR = 2


class Run:
    """One run: its processes, what is heard of them, and what a person sees."""

    def __init__(
        self,
        scenario: Scenario,
        plan: Sequence[ProcessSpec],
        folder: RunFolder,
        printer: Printer,
        lock: DomainLock,
    ) -> None:
        self._duration = scenario.duration
        self._folder = folder
        self._printer = printer
        self._lock = lock
        self._names = [spec.name for spec in plan]
        self._children: dict[str, Child] = {}
        self._used: tuple[float, dict[str, float]] = (0.0, {})
        self._stops_asked = self._stops_done = 0
        self._supervisor = Supervisor(plan, self._launch, printer.tell, patience_of(scenario))
        self.graph = GraphNews(self._names)
        self._statistics = self.graph.diagnostics.statistics
        self._statistics.details['scenario'] = scenario.name
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask_to_stop)

    def until_it_ends(self) -> RunOutcome:
        """Watch the run; Ctrl-C ends it in order, a second one at once."""
        outcome, next_status, began = None, 0.0, time.monotonic()
        try:
            while outcome is None:
                now = time.monotonic()
                self._statistics.begin(time.monotonic_ns())
                news = self.graph.listen(now)
                self._obey()
                phase = self._supervisor.phase
                outcome = self._supervisor.step(now, news)
                if self._supervisor.phase is not phase:
                    self._printer.say(f'{now - began:.1f} s: {self._supervisor.phase.value}')
                if now >= next_status:
                    next_status = now + STATUS_S
                    self._show(now, news)
                self._statistics.tick(round(1e9 * (time.monotonic() - now)))
                time.sleep(PERIOD_S)
        finally:
            self._supervisor.kill()
            self._printer.end()
        return outcome

    def _launch(self, spec: ProcessSpec) -> Child:
        variables = {**os.environ, 'ROS_LOG_DIR': str(self._folder.path / 'logs' / 'ros')}
        command = node_command(spec, os.getpid())
        child = Child(spec, command, self._folder.path, variables, self._printer.tell)
        self._children[spec.name] = child
        return child

    def _ask_to_stop(self, number: int, frame: object) -> None:
        self._stops_asked += 1

    def _obey(self) -> None:
        """Do what signals asked for since the last time."""
        if self._stops_asked > self._stops_done:
            self._stops_done = self._stops_asked
            if self._stops_asked == 1:
                self._printer.say('stopping; Ctrl-C again kills')
                self._supervisor.stop()
            else:
                self._supervisor.kill()

    def _show(self, now: float, news: News) -> None:
        """Bring the status up to date, and note what a killed process would leave."""
        used, held = {}, shared_memory.held_by(os.getpid())
        for name, child in self._children.items():
            child.note_resources()
            held |= child.segments
            seconds = processor_time(child.pid)
            if seconds is not None:
                used[name] = seconds
        self._lock.note(held)
        before, self._used = self._used, (now, used)
        shares = processor_shares(before[1], used, now - before[0])
        reports = reports_of_run(self._names, self._supervisor.ended, self.graph.heard, now)
        self._tell_health(reports)
        rows = [row_of(report, shares.get(report.name)) for report in reports]
        wall_time = self.graph.wall_time
        progress = progress_line(news.clock, self._duration, wall_time, news.paused)
        self._printer.status(now, progress, rows)

    def _tell_health(self, reports: list[Report]) -> None:
        """Tell of the run, and of those who can't tell any more how they fare."""
        others = [report for report in reports if is_told_of(report)]
        there = [name for name in self._names if name not in self._supervisor.ended]
        self._statistics.details['nodes'] = ' '.join(there)
        self._statistics.state = 'running'
        self._statistics.details['phase'] = self._supervisor.phase.value
        self._statistics.faults = faults_of_run(reports)
        self.graph.diagnostics.publish(time.monotonic_ns(), others)


def check_writable(path: Path) -> None:
    """Make sure, before anything starts, that a file can be written at the end.

    Raises:
        LayeredCbfError: If it can't.
    """
    try:
        path.open('a').close()
    except OSError as error:
        raise LayeredCbfError(f'--json {path}: {error.strerror}; name another file') from None


def supervise(options: Options) -> int:
    """Carry out a whole run; return the exit code."""
    time_mode = REAL_TIME if options.real_time else None
    scenario = with_overrides(
        load_scenario(options.scenario), options.seed, options.duration, time_mode
    )
    if options.joystick is not None:
        presets = find_folder('params') / 'joystick'
        scenario = with_joystick(scenario, presets, options.joystick)
    check_host(scenario, options.host)
    if options.json is not None:
        check_writable(options.json)
    if options.front is not None:
        check_front(options.front)
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    lock = DomainLock(domain if options.host == ALL else f'{domain}_{options.host}')
    shared_memory.remove(lock.leftovers)
    date = time.strftime('%Y%m%d_%H%M%S')
    record = options.record and options.host in (ALL, BASE)
    epoch = time.time() if options.epoch is None else options.epoch
    folder = make_run_folder(scenario, date, options.output, record, round(epoch * NS_PER_S))
    printer = Printer(sys.stdout, sys.stdout.isatty())
    printer.say(f'{scenario.name}: {scenario.description}\nrun in {folder.path}')
    plan = process_plan(scenario, folder.parameters, record, options.host)
    if options.front is not None:
        plan = (*plan, viewer_process(options.front.arguments()))
    run = Run(scenario, plan, folder, printer, lock)
    outcome = run.until_it_ends()
    wall_time = run.graph.wall_time
    run.graph.diagnostics.close()
    run.graph.destroy_node()
    shared_memory.remove_ports(int(domain))
    lock.release()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)  # no process is left that would need care
    from layered_cbf_ros.supervision.conclusion import conclude  # loads matplotlib: not before

    return conclude(folder, outcome, wall_time, options.json, printer.say)


def main() -> None:
    """Run the supervisor, show what a running one and all others tell, or give an order."""
    arguments = remove_ros_args(sys.argv)[1:]
    if arguments[:1] == [WORD]:
        run_verb(lambda _: show_status(parse_status(arguments[1:])))
    if arguments[:1] and arguments[0] in ORDERS:
        run_verb(lambda _: give_order(parse_order(arguments[0], arguments[1:])))
    options = parse(arguments)
    try:
        find_each_other_fast()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        code = supervise(options)
    except LayeredCbfError as error:
        print(f'ERROR {error}', file=sys.stderr)
        code = EXIT_ERROR
    rclpy.try_shutdown()
    sys.exit(code)
