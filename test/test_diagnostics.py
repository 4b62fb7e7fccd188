"""What every node tells of itself once a second, and how a person gets to see it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_node import DOMAIN
from live_run import ENVIRONMENT, LiveRun
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from layered_cbf_ros.bags.run.node_health import NodeHealth
from layered_cbf_ros.health import HOLD_NS, TOLD_BY, Fault, Level, Report
from layered_cbf_ros.loop_statistics import KEPT, LoopStatistics, percentiles
from layered_cbf_ros.nodes.diagnostics import DiagnosticsPublisher, report_of, status_of
from layered_cbf_ros.run_nodes import SIMULATOR as PLANT
from layered_cbf_ros.supervision.status import Heard
from layered_cbf_ros.supervision.status_command import (
    aged,
    exit_code,
    headline,
    members,
    status_json,
    summary_of,
)
from layered_cbf_ros.supervision.status_table import row_of, table_lines

MS, S = 1_000_000, 1_000_000_000
WBC, COORDINATOR = '/a1_0/whole_body_controller', '/coordinator'
PROGRAM = 'from layered_cbf_ros.nodes.supervisor import main; main()'


class History:
    """A node's life, second by second, with a clock that is turned by hand."""

    def __init__(self, real_time: bool = False) -> None:
        self.now_ns = 100 * S
        self.node = LoopStatistics()
        self.node.state, self.node.real_time = 'running', real_time
        self.node.report(self.now_ns)

    def second(self, ticks: int = 100, **counted: int) -> tuple[Level, str]:
        """Let a second pass in which things are counted; return level and message."""
        for _ in range(ticks):
            self.node.tick(0)
        for name, count in counted.items():
            setattr(self.node, name, getattr(self.node, name) + count)
        self.now_ns += S
        return self.node.report(self.now_ns)[:2]


def test_who_only_works_is_well():
    assert History().second() == (Level.OK, 'running')


def test_a_refused_message_is_named_for_a_while_and_stays_counted():
    history = History()
    history.node.reject('/state: stamp 0.000 s is 1.000 s in the past')
    level, message = history.second()
    assert level is Level.WARN
    assert message == '1 rejected: /state: stamp 0.000 s is 1.000 s in the past'
    told = [history.second() for _ in range(HOLD_NS // S + 1)]
    assert {level for level, _ in told[:-1]} == {Level.WARN}
    assert told[0][1] == f'1 s ago: {message}'
    assert told[-1] == (Level.OK, 'running')
    assert history.node.report(history.now_ns)[2]['rejected'] == '1'


@pytest.mark.parametrize(
    ('counted', 'expected'),
    [
        ({'solver_failures': 1}, Level.WARN),
        ({'solver_failures': 51}, Level.ERROR),
        ({'without_input': 50}, Level.WARN),
        ({'without_input': 51}, Level.ERROR),
        ({'slack_events': 100}, Level.WARN),
        ({'lost': 1}, Level.WARN),
        ({'deadline_misses': 100}, Level.OK),
    ],
)
def test_a_node_that_mostly_fails_is_in_error_and_one_that_sometimes_does_warns(counted, expected):
    """Of a hundred ticks; in lockstep nobody is late."""
    assert History().second(**counted)[0] is expected


@pytest.mark.parametrize(('misses', 'expected'), [(1, Level.OK), (2, Level.WARN)])
def test_in_real_time_one_late_tick_in_a_hundred_is_bridged(misses, expected):
    assert History(real_time=True).second(deadline_misses=misses)[0] is expected


def test_an_error_that_is_over_is_a_warning_and_then_nothing():
    history = History()
    history.node.details = {'e_stop': 'latched', 'frozen': ''}
    assert [history.second()[0] for _ in range(20)] == [Level.ERROR] * 20
    history.node.details = {'e_stop': '', 'frozen': ''}
    levels = [history.second()[0] for _ in range(HOLD_NS // S + 1)]
    assert levels == [Level.WARN] * (HOLD_NS // S) + [Level.OK]


@pytest.mark.parametrize(
    ('details', 'level', 'words'),
    [
        ({'e_stop': 'latched'}, Level.ERROR, 'emergency stop latched'),
        ({'frozen': 'a1_1, a1_2'}, Level.ERROR, 'frozen: a1_1, a1_2'),
        ({'tracks_left_out': '3'}, Level.WARN, '3 tracks left out'),
        ({'tracks_left_out': '0', 'frozen': '', 'e_stop': ''}, Level.OK, 'running'),
    ],
)
def test_what_the_coordinator_tells_has_a_level(details, level, words):
    history = History()
    history.node.details = details
    assert history.second() == (level, words)


def test_the_worst_is_told_first():
    history = History()
    history.node.faults = (Fault('a', Level.ERROR, 'the floor is wet'),)
    history.node.reject('no joint FL')
    assert history.second() == (Level.ERROR, 'the floor is wet; 1 rejected: no joint FL')


@pytest.mark.parametrize(
    ('real_time', 'idle', 'expected'),
    [
        (False, False, Level.WARN),  # a partner does not answer
        (False, True, Level.OK),  # the plant keeps the time: it may be paused
        (True, True, Level.ERROR),  # the robot's state is missing
    ],
)
def test_a_long_wait_is_told_by_what_it_is_for(real_time, idle, expected):
    history = History(real_time)
    history.node.wait_for('/state', history.now_ns + 1, idle)
    levels = [history.second(0)[0] for _ in range(3)]
    assert levels == [Level.OK, Level.OK, expected]
    history.node.begin(history.now_ns)
    assert history.second()[0] is min(expected, Level.WARN)


def test_many_short_waits_are_no_long_one():
    """A slow partner makes each tick wait; only one that does not come is missing."""
    history = History()
    for _ in range(10):
        history.node.begin(history.now_ns)
        history.node.wait_for(WBC, history.now_ns + 900 * MS)
        assert history.second()[0] is Level.OK


# --- figures ------------------------------------------------------------------------


def test_statistics_tell_what_was_counted():
    statistics = LoopStatistics()
    for duration in range(1, 101):
        statistics.tick(duration * 1000)
    statistics.reject('joint state has no FL')
    _, _, first = statistics.report(1 * S)
    assert first['ticks'] == '100'
    assert first['rejected'] == '1'
    assert first['last_rejected'] == 'joint state has no FL'
    assert first['solve_time_max_us'] == '100'
    assert float(first['solve_time_p50_us']) == pytest.approx(np.median(range(1, 101)), abs=0.5)
    for _ in range(50):
        statistics.tick(1000)
    assert statistics.report(1500 * MS)[2]['rate_hz'] == '100.0'


def test_percentiles_are_within_one_rank_of_those_of_sorted_values():
    values = np.random.default_rng(1).integers(0, 10**9, 4097)
    ordered = np.sort(values)
    for share in (0.0, 0.5, 0.99, 1.0):
        (found,) = percentiles(values, (share,))
        rank = int(np.searchsorted(ordered, found))
        assert abs(rank - share * (len(values) - 1)) <= 1.0
    assert percentiles(values[:0], (0.5, 0.99)) == [0, 0]


def ticked(statistics: LoopStatistics, intervals_ns) -> dict[str, str]:
    """Begin ticks at these intervals; return the figures."""
    now_ns = 100 * S
    statistics.begin(now_ns)
    for interval_ns in intervals_ns:
        now_ns += int(interval_ns)
        statistics.begin(now_ns)
    return statistics.report(now_ns)[2]


def test_in_real_time_jitter_is_the_deviation_from_the_period():
    """Ticks that alternate 50 us late and early of 1 ms, once 3 ms late and soon back."""
    statistics = LoopStatistics()
    statistics.real_time, statistics.period_ns = True, MS
    intervals = np.where(np.arange(2000) % 2, MS - 50_000, MS + 50_000)
    intervals[1000] += 3 * MS
    told = ticked(statistics, intervals)
    assert (told['jitter_from'], told['jitter_nominal_us']) == ('period', '1000')
    assert (told['jitter_p99_us'], told['jitter_max_us']) == ('50', '3050')


def test_in_lockstep_jitter_is_the_deviation_from_the_median_interval():
    """The machine needs 2.5 ms a tick: that is slow, but steady."""
    statistics = LoopStatistics()
    statistics.period_ns = MS
    told = ticked(statistics, [2_500_000] * 500)
    assert (told['jitter_from'], told['jitter_nominal_us']) == ('median', '2500')
    assert (told['jitter_p99_us'], told['jitter_max_us']) == ('0', '0')


def test_a_pause_is_no_jitter():
    told = ticked(LoopStatistics(), [MS] * 300 + [60 * S] + [MS] * 300)
    assert told['jitter_max_us'] == '0'


def test_the_greatest_jitter_is_of_the_whole_run_and_its_percentile_of_the_last_ticks():
    statistics = LoopStatistics()
    statistics.real_time, statistics.period_ns = True, MS
    ticked(statistics, [MS] * 100 + [9 * MS] * 100)
    told = ticked(statistics, [MS] * KEPT)
    assert (told['jitter_p99_us'], told['jitter_max_us']) == ('0', '8000')


def test_the_real_time_factor_is_of_stamps_over_wall_time():
    statistics = LoopStatistics()
    statistics.begin(10 * S, 0)
    statistics.report(10 * S)
    statistics.begin(12 * S, 500 * MS)
    told = statistics.report(12 * S)[2]
    assert (told['stamp_s'], told['real_time_factor']) == ('0.500', '0.25')


# --- messages -----------------------------------------------------------------------


class FakeNode:
    """A node without middleware that keeps what it publishes."""

    def __init__(self, namespace: str = '/a1_0') -> None:
        self.sent: list[DiagnosticArray] = []
        self._namespace = namespace

    def get_fully_qualified_name(self) -> str:
        return WBC

    def get_namespace(self) -> str:
        return self._namespace

    def create_publisher(self, kind, topic, qos):
        assert topic == '/diagnostics'
        return SimpleNamespace(publish=self.sent.append, wait_for_all_acked=lambda limit: True)

    def get_clock(self):
        stamp = DiagnosticArray().header.stamp
        stamp.sec = 7
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: stamp))


def test_a_node_tells_once_a_second_however_its_turns_fall():
    """Turns every 70 ms and a hang of 3.5 s: the beat is kept, and nothing is made up for."""
    node = FakeNode()
    publisher = DiagnosticsPublisher(node)
    start_ns = 50 * S
    for turn in range(150):
        publisher.serve(start_ns + turn * 70 * MS)
    assert len(node.sent) == 11  # at 0, 1, ..., 10 s
    late_ns = start_ns + 14 * S
    for turn in range(10):
        publisher.serve(late_ns + turn * 70 * MS)
    assert len(node.sent) == 12


def test_a_status_is_as_an_aggregator_wants_it():
    """It sorts by name, complains about a message without stamp, and groups by hardware."""
    robots, others = FakeNode(), FakeNode('/')
    for node in (robots, others):
        DiagnosticsPublisher(node).publish(S)
    (status,) = robots.sent[0].status
    assert (status.name, status.hardware_id) == (WBC, 'a1_0')
    assert status.level == DiagnosticStatus.OK
    assert robots.sent[0].header.stamp.sec == 7
    assert others.sent[0].status[0].hardware_id == os.uname().nodename
    keys = [entry.key for entry in status.values]
    assert len(keys) == len(set(keys))
    assert {
        'state', 'rate_hz', 'ticks', 'deadline_misses', 'jitter_p99_us', 'jitter_max_us',
        'solve_time_p50_us', 'solve_time_p99_us', 'solve_time_max_us', 'rejected',
        'last_rejected', 'faults', 'waiting_for',
    } <= set(keys)  # fmt: skip


@pytest.mark.parametrize('level', list(Level))
def test_a_report_survives_its_way_as_a_message(level):
    report = Report(WBC, level, 'words', {'state': 'running', 'ticks': '3'}, 'a1_0')
    assert report_of(status_of(report)) == report
    names = {'OK': b'\0', 'WARN': b'\1', 'ERROR': b'\2', 'STALE': b'\3'}
    assert status_of(report).level == names[level.name] == getattr(DiagnosticStatus, level.name)


def test_a_level_that_nobody_knows_is_an_error():
    assert report_of(DiagnosticStatus(level=b'\x09', name='x')).level is Level.ERROR


def test_the_words_of_a_supervisor_on_a_silent_node_are_not_counted():
    """A node counts 5, hangs, and counts 6: that is no restart, and 6 in all."""

    def message(count: str, **extra: str) -> SimpleNamespace:
        values = {'rejected': count, **extra}
        entries = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
        return SimpleNamespace(status=[SimpleNamespace(name=WBC, values=entries)])

    health = NodeHealth()
    for told in (message('5'), message('0', **{TOLD_BY: '/supervisor'}), message('6')):
        health.add(told, None)
    assert health.totals()[WBC]['rejected'] == 6


# --- supervisor status --------------------------------------------------------------


def of(name: str, level: Level = Level.OK, **values: str) -> Report:
    return Report(name, level, 'words', {'state': 'running', **values})


@pytest.mark.parametrize(
    ('levels', 'code'),
    [
        ([Level.OK, Level.OK], 0),
        ([Level.OK, Level.WARN], 1),
        ([Level.WARN, Level.ERROR], 2),
        ([Level.OK, Level.STALE], 2),
        ([], 2),
    ],
)
def test_the_exit_code_is_that_of_the_worst(levels, code):
    assert exit_code([of(f'/{k}', level) for k, level in enumerate(levels)]) == code


def test_who_falls_silent_or_never_spoke_is_stale_but_not_who_ended():
    last = {
        WBC: Heard(of(WBC), 10.0),
        COORDINATOR: Heard(of(COORDINATOR), 13.0),
        '/gone': Heard(of('/gone', state='ended'), 1.0),
    }
    reports = aged(last, ['/mute'], 13.5)
    assert {report.name: report.level for report in reports} == {
        WBC: Level.STALE, COORDINATOR: Level.OK, '/gone': Level.OK, '/mute': Level.STALE
    }  # fmt: skip


def test_a_supervisor_says_who_belongs_to_its_run():
    supervisor = of('/supervisor', nodes=f'{WBC} {PLANT}')
    assert members({'/supervisor': Heard(supervisor, 0.0)}) == {WBC, PLANT}
    assert members({WBC: Heard(of(WBC), 0.0)}) == set()


def test_the_headline_gathers_what_single_nodes_know():
    reports = [
        of('/supervisor', scenario='four_agents', phase='running'),
        of(PLANT, stamp_s='12.340', real_time_factor='0.26', paused='true'),
        of(COORDINATOR, Level.ERROR, e_stop='latched'),
    ]
    assert headline(summary_of(reports)) == (
        'four_agents, running, 12.340 s simulated, real-time factor 0.26, paused, EMERGENCY STOP'
    )
    told = json.loads(json.dumps(status_json(reports)))
    assert (told['level'], told['simulated_s'], told['e_stop']) == ('ERROR', 12.34, True)
    assert [node['name'] for node in told['nodes']] == ['/supervisor', PLANT, COORDINATOR]


def test_the_table_shows_foreign_nodes_too_and_every_figure_below_its_heading():
    values = {'rate_hz': '999.6', 'deadline_misses': '4', 'solve_time_p99_us': '1234'}
    foreign = Report('camera: rate', Level.WARN, 'frames dropped', {'fps': '12'})
    lines = table_lines([row_of(of(WBC, **values), 0.5), row_of(foreign)])
    heading, own, camera = lines
    for name, text in (('rate', '1000 Hz'), ('missed', '4'), ('p99', '1.23'), ('CPU', '50 %')):
        end = heading.index(f' {name} ') + 1 + len(name)
        assert own[:end].endswith(text)
    assert camera.split() == ['camera:', 'rate', 'WARN', 'frames', 'dropped']
    assert 'CPU' not in table_lines([row_of(foreign)])[0]


def test_a_narrow_terminal_still_shows_what_is_wrong():
    lines = table_lines([row_of(of(WBC, Level.ERROR, faults='emergency stop latched'))], 60)
    assert max(map(len, lines)) < 60
    assert lines[-1].strip() == 'emergency stop latched'


def test_only_the_level_is_painted():
    rows = [row_of(of(WBC, Level.ERROR))]
    plain, painted = table_lines(rows)[1], table_lines(rows, coloured=True)[1]
    assert painted == plain.replace('ERROR', '\x1b[31mERROR\x1b[0m', 1)


# --- real processes -----------------------------------------------------------------


def status(*options: str) -> subprocess.CompletedProcess[str]:
    """Run `supervisor status` beside whatever runs."""
    return subprocess.run(
        [sys.executable, '-c', PROGRAM, 'status', *options],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


@pytest.mark.system
def test_with_nobody_there_one_line_says_so():
    found = status()
    assert found.returncode == 2
    assert found.stderr.splitlines() == [found.stderr.strip()]
    assert f'ROS_DOMAIN_ID {DOMAIN}' in found.stderr
    assert 'scripts/demo' in found.stderr


@pytest.mark.system
def test_a_scenario_called_status_is_not_mistaken_for_the_question(tmp_path):
    path = tmp_path / 'status'
    path.write_text('seed: 1\n')
    run = subprocess.run(
        [sys.executable, '-c', PROGRAM, str(path)],
        env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True, timeout=60.0, check=False,
    )  # fmt: skip
    assert run.returncode == 2
    assert run.stderr.startswith('ERROR status:1: ')


WORLD = """
description: One robot stands, and nobody gives up early.
duration: 600.0
robots: [{name: a1_0, position: [0.0, 0.0]}]
parameters:
  simulator: {patience: 60.0}
  coordinator: {patience: 60.0}
  ground_force_mpc: {patience: 60.0}
  whole_body_controller: {patience: 60.0}
"""
NODES = {
    '/supervisor', PLANT, COORDINATOR, '/recorder', WBC, '/a1_0/ground_force_mpc',
}  # fmt: skip


class Ear:
    """Hears /diagnostics, and can send states that nobody should believe."""

    def __init__(self) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self.node = Node('ear', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.heard: dict[str, list[tuple[float, Report]]] = {}
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._note, 100)
        self.states = self.node.create_publisher(JointState, '/state', 10)

    def _note(self, message: DiagnosticArray) -> None:
        for each in message.status:
            self.heard.setdefault(each.name, []).append((time.monotonic(), report_of(each)))

    def until(self, condition, limit: float = 60.0) -> None:
        end = time.monotonic() + limit
        while not condition():
            assert time.monotonic() < end, {n: told[-1][1] for n, told in self.heard.items()}
            self._executor.spin_once(timeout_sec=0.05)

    def last(self, name: str) -> Report:
        return self.heard[name][-1][1]

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def run(tmp_path):
    (tmp_path / 'calm.yaml').write_text(WORLD)
    run = LiveRun(tmp_path / 'calm.yaml', tmp_path / 'run')
    try:
        run.until_running()
        yield run
    finally:
        run.process.send_signal(signal.SIGINT)
        run.end()


@pytest.fixture
def ear():
    ear = Ear()
    yield ear
    ear.close()


@pytest.mark.system
def test_a_person_sees_who_is_well_who_refused_something_and_who_hangs(run, ear):
    """One robot in lockstep; a hung controller makes all others wait, and each says so."""
    ear.until(lambda: all(len(ear.heard.get(name, ())) > 5 for name in NODES))
    for name in NODES:
        gaps = np.diff([at for at, _ in ear.heard[name]])
        assert 0.8 < np.median(gaps) < 1.3, (name, gaps)
    ear.until(lambda: all(ear.last(name).level is Level.OK for name in NODES))
    found = status('--json')
    assert found.returncode == 0
    assert {node['name'] for node in json.loads(found.stdout)['nodes']} == NODES

    ear.states.publish(JointState(velocity=[0.0], effort=[0.0]))  # its stamp is long over
    ear.until(lambda: ear.last(WBC).level is Level.WARN)
    assert 'rejected: /state: stamp 0.000 s' in ear.last(WBC).message
    ear.until(lambda: ear.last(WBC).level is Level.OK)
    assert ear.last(WBC).values['rejected'] == '1'

    os.kill(run.children[WBC], signal.SIGSTOP)
    try:
        ear.until(lambda: ear.last(WBC).level is Level.STALE)
        ear.until(lambda: f'waits for {WBC}' in ear.last(PLANT).message)
        found = status('--json')
        assert found.returncode == 2
        told = {node['name']: node for node in json.loads(found.stdout)['nodes']}
        assert told[WBC]['level'] == 'STALE'
        assert 'silent' in told[WBC]['message']
        assert told[PLANT]['level'] == 'WARN'
        assert f'{WBC} silent' in told['/supervisor']['message']
    finally:
        os.kill(run.children[WBC], signal.SIGCONT)
    ear.until(lambda: all(ear.last(name).level is Level.OK for name in NODES))
    assert set(ear.heard) == NODES
