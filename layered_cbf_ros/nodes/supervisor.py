"""supervisor: starts every node of a scenario, watches them, ends them, and judges the run."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.nodes.graph_news import GraphNews
from layered_cbf_ros.nodes.transport import find_each_other_fast
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import load_scenario, with_overrides
from layered_cbf_ros.supervision import shared_memory
from layered_cbf_ros.supervision.child import Child, node_command
from layered_cbf_ros.supervision.command_line import Options, parse
from layered_cbf_ros.supervision.domain_lock import DomainLock
from layered_cbf_ros.supervision.printer import Printer, progress_line
from layered_cbf_ros.supervision.process_plan import ProcessSpec, process_plan
from layered_cbf_ros.supervision.run_folder import RunFolder, make_run_folder
from layered_cbf_ros.supervision.status import processor_shares, processor_time, status_rows
from layered_cbf_ros.supervision.supervisor import News, RunOutcome, Supervisor
from layered_cbf_ros.timing import REAL_TIME

PERIOD_S = 0.05
STATUS_S = 1.0
EXIT_ERROR = 2


class Run:
    """One run: its processes, what is heard of them, and what a person sees."""

    def __init__(
        self, scenario: Scenario, folder: RunFolder, printer: Printer, lock: DomainLock
    ) -> None:
        plan = process_plan(scenario, folder.parameters, folder.recorded)
        self._duration = scenario.duration
        self._folder = folder
        self._printer = printer
        self._lock = lock
        self._names = [spec.name for spec in plan]
        self._children: dict[str, Child] = {}
        self._used: tuple[float, dict[str, float]] = (0.0, {})
        self._stops_asked = self._stops_done = 0
        self._supervisor = Supervisor(plan, self._launch, printer.tell)
        self.graph = GraphNews(self._names)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask_to_stop)

    def until_it_ends(self) -> RunOutcome:
        """Watch the run; Ctrl-C ends it in order, a second one at once."""
        outcome, next_status, began = None, 0.0, time.monotonic()
        try:
            while outcome is None:
                now = time.monotonic()
                news = self.graph.listen(now)
                self._obey()
                phase = self._supervisor.phase
                outcome = self._supervisor.step(now, news)
                if self._supervisor.phase is not phase:
                    self._printer.say(f'{now - began:.1f} s: {self._supervisor.phase.value}')
                if now >= next_status:
                    next_status = now + STATUS_S
                    self._show(now, news)
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
        ended = self._supervisor.ended
        rows = status_rows(self._names, ended, news.ready, self.graph.reports, shares, now)
        progress = progress_line(news.clock, self._duration, self.graph.wall_time)
        self._printer.status(now, progress, rows)


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
    if options.json is not None:
        check_writable(options.json)
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    lock = DomainLock(domain)
    shared_memory.remove(lock.leftovers)
    date = time.strftime('%Y%m%d_%H%M%S')
    folder = make_run_folder(scenario, date, options.output, options.record)
    printer = Printer(sys.stdout, sys.stdout.isatty())
    printer.say(f'{scenario.name}: {scenario.description}\nrun in {folder.path}')
    run = Run(scenario, folder, printer, lock)
    outcome = run.until_it_ends()
    wall_time = run.graph.wall_time
    run.graph.destroy_node()
    shared_memory.remove_ports(int(domain))
    lock.release()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)  # no process is left that would need care
    from layered_cbf_ros.supervision.conclusion import conclude  # loads matplotlib: not before

    return conclude(folder, outcome, wall_time, options.json, printer.say)


def main() -> None:
    """Run the supervisor."""
    options = parse(remove_ros_args(sys.argv)[1:])
    try:
        find_each_other_fast()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        code = supervise(options)
    except LayeredCbfError as error:
        print(f'ERROR {error}', file=sys.stderr)
        code = EXIT_ERROR
    rclpy.try_shutdown()
    sys.exit(code)
