"""A run starts whole, ends in order, names who spoilt it, and leaves nothing behind."""

import io
import mmap
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

from layered_cbf_ros.errors import GraphError, LayeredCbfError, ParameterError
from layered_cbf_ros.health import Level, Report
from layered_cbf_ros.operation.parameters import JoystickParameters
from layered_cbf_ros.parameters import read_parameter_file
from layered_cbf_ros.patterns import Standing
from layered_cbf_ros.resources import find_folder
from layered_cbf_ros.run_nodes import node_names
from layered_cbf_ros.scenario import Desired, Detections, Obstacle, Rates, Robot, Scenario, World
from layered_cbf_ros.scenario_checks import problems
from layered_cbf_ros.scenario_file import from_json, load_scenario, to_json
from layered_cbf_ros.supervision import shared_memory
from layered_cbf_ros.supervision.child import Child, describe_exit, node_command
from layered_cbf_ros.supervision.command_line import parse
from layered_cbf_ros.supervision.domain_lock import DomainLock
from layered_cbf_ros.supervision.hosts import check_host, share_of
from layered_cbf_ros.supervision.printer import Printer, progress_line
from layered_cbf_ros.supervision.process_plan import ProcessSpec, patience_of, process_plan
from layered_cbf_ros.supervision.run_folder import make_run_folder
from layered_cbf_ros.supervision.run_parameters import (
    explicit,
    parameter_file,
    read_defaults,
    run_parameters,
    with_joystick,
)
from layered_cbf_ros.supervision.shutdown import Patience
from layered_cbf_ros.supervision.status import (
    Heard,
    faults_of_run,
    is_told_of,
    processor_shares,
    processor_time,
    reports_of_run,
)
from layered_cbf_ros.supervision.status_table import row_of
from layered_cbf_ros.supervision.supervisor import Code, News, Supervisor, root_cause

SCENARIO = Scenario(
    name='two',
    description='Two robots and an obstacle.',
    seed=3,
    duration=5.0,
    time='lockstep',
    plant='bullet',
    goal_tolerance=0.2,
    robots=(
        Robot('a1_0', (0.0, 0.0), desired=Desired(goal=(4.0, 0.0))),
        Robot('a1_1', (0.0, 2.0)),
    ),
    obstacles=(Obstacle('obstacle_1', 0.2, 0.8, Standing((2.0, 1.0))),),
    world=World(detections=Detections(delay=0.03)),
)
NAMES = [
    '/recorder',
    '/coordinator',
    '/obstacle_tracker',
    '/a1_0/ground_force_mpc',
    '/a1_0/whole_body_controller',
    '/a1_1/ground_force_mpc',
    '/a1_1/whole_body_controller',
    '/simulator',
]
SIM, WBC, MPC, RECORDER = '/simulator', NAMES[4], NAMES[3], '/recorder'
ALL_READY = News(ready=frozenset(NAMES), clock=0.1)


# --- the plan and its parameters ---------------------------------------------------


def test_a_run_has_a_process_for_every_node_and_starts_listeners_first():
    plan = process_plan(SCENARIO, Path('/run/params.yaml'), record=True)
    assert [spec.name for spec in plan] == NAMES
    assert plan[4].executable == 'whole_body_controller'
    assert plan[4].arguments[-1] == '__ns:=/a1_0'
    assert plan[4].log_name == 'a1_0.whole_body_controller.log'
    assert {spec.name: spec.turn for spec in plan if spec.turn} == {RECORDER: 2}
    assert [spec.name for spec in plan if spec.ends_itself] == [RECORDER]


def test_only_what_keeps_no_world_restarts_and_only_in_real_time():
    assert not any(spec.restarts for spec in process_plan(SCENARIO, Path('p'), True))
    plan = process_plan(replace(SCENARIO, time='real_time'), Path('p'), True)
    once = {spec.name for spec in plan if not spec.restarts}
    wbcs = {spec.name for spec in plan if spec.executable == 'whole_body_controller'}
    assert once == {SIM, RECORDER, *wbcs}
    assert {spec.name for spec in plan if not spec.ends_run} == wbcs


def test_without_obstacles_nobody_tracks_and_without_bag_nobody_records():
    names = [spec.name for spec in process_plan(replace(SCENARIO, obstacles=()), Path('p'), False)]
    assert '/obstacle_tracker' not in names
    assert RECORDER not in names


WIRED = replace(SCENARIO, time='real_time', plant='emulated_a1', states='estimator', pace=0.5)


@pytest.mark.parametrize(
    ('scenario', 'nodes', 'plant'),
    [
        (WIRED, ('a1_driver', 'state_estimator'), '/a1_emulator'),
        (replace(WIRED, states='truth'), ('a1_driver',), '/a1_emulator'),
        (replace(WIRED, plant='a1'), ('a1_driver', 'state_estimator'), None),
        (replace(SCENARIO, states='estimator'), ('state_estimator',), SIM),
    ],
)
def test_one_word_puts_drivers_and_estimators_between_the_layers_and_their_plant(
    scenario, nodes, plant
):
    plan = process_plan(scenario, Path('p'), True)
    usual = {spec.name for spec in process_plan(SCENARIO, Path('p'), True)} - {SIM}
    added = {f'/{robot.name}/{node}' for robot in scenario.robots for node in nodes}
    assert {spec.name for spec in plan} == usual | added | ({plant} - {None})
    assert [spec.name for spec in plan if spec.keeps_time] == ([plant] if plant else [])


def test_a_driver_ends_before_its_robot_does_and_in_order_even_if_its_supervisor_dies():
    turns = {spec.name: spec.turn for spec in process_plan(WIRED, Path('p'), True)}
    drivers = {f'/{robot.name}/a1_driver' for robot in WIRED.robots}
    assert {turns[name] for name in drivers} == {0}
    assert turns['/a1_emulator'] == 1
    assert turns[RECORDER] == 2
    itself = {s.name for s in process_plan(WIRED, Path('p'), True) if s.ends_itself}
    assert itself == drivers | {RECORDER}
    assert patience_of(WIRED).interrupt - patience_of(SCENARIO).interrupt >= 1.6 / WIRED.pace


def test_each_driver_finds_its_own_robot_and_arms_only_an_emulated_one():
    defaults = read_defaults(find_folder('params'))
    values = run_parameters(WIRED, defaults, Path('s'), None, epoch_ns=123)
    first, second = (values[f'/{robot.name}/a1_driver'] for robot in WIRED.robots)
    assert (first['address'], first['port']) == ('127.0.0.1', 8007)
    assert second['port'] == first['port'] + 1
    assert second['local_port'] == first['local_port'] + 1
    assert first['arm_at_start']
    assert (first['epoch_ns'], first['pace']) == (123, 0.5)
    robots = (replace(WIRED.robots[0], address='10.0.0.7:8008'), *WIRED.robots[1:])
    real = replace(WIRED, plant='a1', robots=robots)
    values = run_parameters(real, defaults, Path('s'), None, epoch_ns=123)
    first, second = (values[f'/{robot.name}/a1_driver'] for robot in WIRED.robots)
    assert (first['address'], first['port']) == ('10.0.0.7', 8008)
    assert (second['address'], second['port']) == ('192.168.123.10', 8007)
    assert not first['arm_at_start']
    assert (first['epoch_ns'], first['pace']) == (0, 1.0)  # real robots live in wall time


def test_layers_that_are_fed_by_an_estimator_hear_it_and_it_knows_where_they_begin():
    values = run_parameters(WIRED, {}, Path('s'), None)
    robot = WIRED.robots[0]
    for node in ('ground_force_mpc', 'whole_body_controller'):
        assert values[f'/{robot.name}/{node}']['state_topic'] == f'/{robot.name}/state'
    estimator = values[f'/{robot.name}/state_estimator']
    assert (estimator['start_x'], estimator['start_y']) == robot.position
    assert not estimator['standing_at_start']  # real robots lie


def test_every_node_of_a_run_on_several_computers_has_one_host_and_only_one():
    names = node_names(WIRED, record=True)
    shares = [share_of(names, host) for host in ('base', *(r.name for r in WIRED.robots))]
    assert sorted(name for share in shares for name in share) == sorted(names)
    assert set(shares[0]) == {RECORDER, '/coordinator', '/obstacle_tracker', '/a1_emulator'}
    assert all(name.startswith(f'/{WIRED.robots[0].name}/') for name in shares[1])
    plan = process_plan(WIRED, Path('p'), True, WIRED.robots[0].name)
    assert [spec.name for spec in plan] == list(shares[1])


@pytest.mark.parametrize(
    ('scenario', 'host', 'words'),
    [
        (WIRED, 'bas', "no host 'bas'; did you mean 'base'"),
        (SCENARIO, 'base', 'plant: bullet runs on one computer'),
    ],
)
def test_a_host_that_has_no_share_is_refused(scenario, host, words):
    with pytest.raises(LayeredCbfError, match=words):
        check_host(scenario, host)


def test_an_emulated_robot_on_another_computer_is_armed_by_a_person():
    emulation = replace(WIRED.emulation, address='10.0.0.1')
    values = run_parameters(replace(WIRED, emulation=emulation), {}, Path('s'), None)
    driver = values[f'/{WIRED.robots[0].name}/a1_driver']
    assert (driver['address'], driver['arm_at_start']) == ('10.0.0.1', False)


def test_the_page_and_the_share_of_a_run_are_chosen_side_by_side():
    options = parse(['--viewer', '--page-host', '0.0.0.0', '--page-port', '9', '--host', 'base'])
    assert (options.front.host, options.front.port, options.host) == ('0.0.0.0', 9, 'base')


def test_scenario_goes_before_defaults_and_the_run_before_both():
    scenario = replace(SCENARIO, parameters={'coordinator': {'alpha1': 2, 'time': 'real_time'}})
    defaults = {'coordinator': {'alpha1': 0.5, 'alpha2': 0.25}}
    values = run_parameters(scenario, defaults, Path('/run/scenario.yaml'), Path('/run/bag'))
    coordinator = values['/coordinator']
    assert (coordinator['alpha1'], coordinator['alpha2']) == (2.0, 0.25)
    assert isinstance(coordinator['alpha1'], float)  # ROS refuses a whole number for a double
    assert coordinator['time'] == 'lockstep'
    assert coordinator['detection_delay'] == 0.03
    assert values[SIM]['wait_for'] == [name for name in NAMES if name != SIM]
    assert values[RECORDER]['output'] == '/run/bag'


def test_an_unknown_parameter_is_refused_before_anything_starts():
    scenario = replace(SCENARIO, parameters={'coordinator': {'alhpa1': 1.0}})
    with pytest.raises(ParameterError, match='alhpa1'):
        run_parameters(scenario, {}, Path('s'), None)


def test_ros_reads_the_parameter_file_as_it_was_meant(tmp_path):
    values = run_parameters(
        SCENARIO, read_defaults(find_folder('params')), Path('/run/scenario.yaml'), None
    )
    file = tmp_path / 'params.yaml'
    file.write_text(parameter_file(values))
    context = rclpy.Context()
    rclpy.init(args=['--ros-args', '--params-file', str(file)], context=context)
    for name, expected in values.items():
        namespace, _, node_name = name.rpartition('/')
        node = Node(
            node_name,
            namespace=namespace or '/',
            context=context,
            start_parameter_services=False,
            automatically_declare_parameters_from_overrides=True,
        )
        for key, value in expected.items():
            found = node.get_parameter(key).value
            assert (list(found) if isinstance(value, list) else found) == value, (name, key)
            assert isinstance(value, list) or type(found) is type(value), (name, key)
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_run_folder_explains_itself_and_is_never_written_over(tmp_path):
    folder = make_run_folder(SCENARIO, '20260101_000000', tmp_path / 'run', record=True)
    run = load_scenario(folder.scenario)
    assert replace(run, parameters={}) == SCENARIO
    assert f'scenario: {folder.scenario}' in folder.parameters.read_text()
    with pytest.raises(LayeredCbfError, match='not empty'):
        make_run_folder(SCENARIO, '20260101_000000', tmp_path / 'run', record=True)


def test_the_scenario_of_a_run_holds_the_values_it_had(tmp_path):
    """Also those of params/*.yaml: a bag is judged by them, and they may have changed since."""
    scenario = replace(SCENARIO, parameters={'coordinator': {'alpha1': 0.7}})
    run = explicit(scenario, {'coordinator': {'agent_radius': 0.4, 'alpha1': 0.5}})
    coordinator = run.parameters['coordinator']
    assert (coordinator['agent_radius'], coordinator['alpha1']) == (0.4, 0.7)
    assert from_json(to_json(run)) == run
    again = run_parameters(run, {}, Path('s'), None)
    defaults = {'coordinator': {'agent_radius': 0.4, 'alpha1': 0.5}}
    assert again == run_parameters(scenario, defaults, Path('s'), None)


def test_files_that_contradict_each_other_are_refused_before_anything_starts():
    with pytest.raises(ParameterError, match=r'com_height differs.*give both the same'):
        explicit(SCENARIO, {'ground_force_mpc': {'com_height': 0.25}})


def test_what_the_run_settles_a_scenario_may_not_give():
    """It would be overwritten without a word."""
    quiet = run_parameters(SCENARIO, {}, Path('s'), None)
    settled = run_parameters(
        replace(
            SCENARIO,
            time='real_time',
            rates=Rates(500, 250, 50),
            world=World(detections=Detections(delay=0.1)),
            robots=tuple(replace(robot, gait='stand') for robot in SCENARIO.robots),
        ),
        {},
        Path('s'),
        None,
    )
    found = {
        (name.rpartition('/')[2], key): value
        for name, values in quiet.items()
        for key, value in values.items()
        if settled[name][key] != value
    }
    assert len(found) == 5 * 5 + 1  # five values at five nodes, and the gait
    for (node, key), value in found.items():
        (problem,) = problems(replace(SCENARIO, parameters={node: {key: value}}))
        assert problem.path == ('parameters', node, key)


# --- the course of a run, with scripted processes ----------------------------------


class FakeProcess:
    """A process that ends when told: by a script, or by the signals it obeys."""

    def __init__(self, obeys=(signal.SIGINT, signal.SIGTERM, signal.SIGKILL)):
        self.code = None
        self.missing = ''
        self.signals = []
        self._obeys = obeys

    def poll(self):
        return self.code

    def send(self, number):
        self.signals.append(number)
        if number in self._obeys and self.code is None:
            self.code = -9 if number == signal.SIGKILL else 0


class History:
    """A run with fake processes and a clock that is turned by hand."""

    def __init__(self, scenario=SCENARIO, **patience):
        self.now = 0.0
        self.told = []
        self.launched = []
        self.obeys = {}
        plan = process_plan(scenario, Path('p'), True)
        self.supervisor = Supervisor(
            plan, self._launch, lambda *told: self.told.append(told), Patience(**patience)
        )

    def _launch(self, spec):
        process = FakeProcess(**self.obeys.get(spec.name, {}))
        self.launched.append((spec.name, process))
        return process

    def __getitem__(self, name):
        return self.supervisor.processes[name]

    def play(self, seconds, news=ALL_READY, step=0.1):
        outcome = None
        end = self.now + seconds
        while self.now < end and outcome is None:
            outcome = self.supervisor.step(self.now, news)
            self.now += step
        return outcome

    def play_clock(self, seconds):
        """Play with simulated time going on."""
        outcome, end = None, self.now + seconds
        while self.now < end and outcome is None:
            outcome = self.play(0.1, replace(ALL_READY, clock=self.now))
        return outcome


def test_when_the_plant_is_done_all_end_and_the_recorder_last():
    run = History()
    assert run.play(1.0) is None
    run[SIM].code = 0
    assert run.play(0.05) is None  # the others are asked to end
    assert run[WBC].signals == [signal.SIGINT]
    assert run[RECORDER].signals == []
    outcome = run.play(1.0)
    assert outcome.code is Code.FINISHED
    assert run[RECORDER].signals == [signal.SIGINT]
    assert all(process.code is not None for _, process in run.launched)


def test_a_node_that_never_gets_ready_is_named():
    run = History(ready=30.0)
    news = News(ready=frozenset(NAMES) - {MPC})
    assert run.play(29.0, news) is None
    outcome = run.play(5.0, news)
    assert outcome.code is Code.FAILED
    assert outcome.missing == (MPC,)


def test_in_lockstep_a_crash_ends_the_run_and_is_named():
    run = History()
    run.play(1.0)
    run[WBC].code = -signal.SIGSEGV
    outcome = run.play(2.0)
    assert (outcome.code, outcome.missing) == (Code.FAILED, (WBC,))
    assert outcome.reason == f'{WBC} was killed by SIGSEGV'


def test_a_node_that_ends_early_without_error_still_fails_the_run():
    run = History()
    run.play(1.0)
    run['/coordinator'].code = 0
    assert run.play(2.0).missing == ('/coordinator',)


@pytest.mark.parametrize(
    ('reports', 'cause'),
    [
        ({SIM: WBC, WBC: MPC}, (MPC,)),
        ({SIM: WBC}, (WBC,)),
        ({SIM: WBC, WBC: SIM}, (SIM, WBC)),
        ({SIM: '/x', WBC: '/y'}, ('/x', '/y')),
        ({SIM: ''}, ()),
    ],
)
def test_whoever_is_missed_but_misses_nobody_is_the_cause(reports, cause):
    assert root_cause(reports) == tuple(sorted(cause))


def test_of_those_who_wait_in_vain_the_last_in_the_chain_is_blamed():
    """A hung MPC: its WBC gives up first, then the simulator gives up on the WBC."""
    run = History(reports=2.0)
    run.play(1.0)
    run[WBC].missing, run[WBC].code = MPC, 3
    assert run.play(1.0) is None
    run[SIM].missing, run[SIM].code = WBC, 3
    outcome = run.play(3.0)
    assert (outcome.code, outcome.missing) == (Code.FAILED, (MPC,))


def test_a_hung_plant_is_noticed_though_nobody_misses_it():
    run = History(standstill=20.0)
    run.play_clock(5.0)
    news = News(frozenset(NAMES), run.now, silent=(SIM,))
    assert run.play(19.0, news) is None
    assert run.play(3.0, news).missing == (SIM,)


def test_in_real_time_too_a_hung_plant_is_noticed_and_no_robot_blamed_that_lies():
    run = History(replace(SCENARIO, time='real_time'), standstill=20.0)
    run.play_clock(5.0)
    run[WBC].code = -signal.SIGKILL
    news = News(frozenset(NAMES), run.now, silent=(WBC, SIM))
    assert run.play(19.0, news) is None
    outcome = run.play(3.0, news)
    assert (outcome.code, outcome.missing) == (Code.FAILED, (SIM,))


def test_slow_but_steady_is_no_standstill():
    run = History(standstill=1.0)
    assert run.play_clock(10.0) is None


def test_the_user_stops_a_run_in_order_and_a_second_word_kills():
    run = History()
    run.obeys = {WBC: {'obeys': (signal.SIGKILL,)}}
    run.play(1.0)
    run.supervisor.stop()
    assert run.play(1.0) is None
    assert run[WBC].signals == [signal.SIGINT]
    run.supervisor.kill()
    outcome = run.play(1.0)
    assert outcome.code is Code.STOPPED
    assert run[WBC].code == -signal.SIGKILL


def test_who_ignores_signals_is_asked_twice_and_then_killed():
    run = History(interrupt=3.0, terminate=2.0)
    run.obeys = {WBC: {'obeys': (signal.SIGKILL,)}}
    run.play(1.0)
    run.supervisor.stop()
    outcome = run.play(4.9)
    assert outcome is None
    outcome = run.play(1.0)
    assert run[WBC].signals == [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]
    assert outcome.code is Code.STOPPED
    assert (WBC, 'was killed') in run.told


def test_in_real_time_a_dead_controller_is_started_again_but_not_for_ever():
    run = History(replace(SCENARIO, time='real_time'), restarts=2, restart=0.5)
    run.play(1.0)
    for count in (1, 2):
        run[MPC].code = -signal.SIGKILL
        assert run.play(1.0) is None
        assert [name for name, _ in run.launched].count(MPC) == 1 + count
        assert run[MPC].code is None
    run[MPC].code = 1
    assert run.play(2.0).missing == (MPC,)


def test_in_real_time_a_robot_that_lost_its_legs_stays_down_and_the_others_go_on():
    run = History(replace(SCENARIO, time='real_time'))
    run.play(1.0)
    run[WBC].code = -signal.SIGKILL
    assert run.play(3.0) is None
    assert [name for name, _ in run.launched].count(WBC) == 1
    run[SIM].code = 0
    assert run.play(1.0).code is Code.FINISHED


def test_the_first_reason_to_end_counts():
    run = History()
    run.play(1.0)
    run[SIM].code = 0
    run.play(0.05)
    run['/coordinator'].code = 1
    run.supervisor.stop()
    assert run.play(1.0).code is Code.FINISHED


def test_options_may_stand_anywhere_and_a_scenario_need_not_be_named():
    assert parse(['--seed', '3', 'stand']).scenario == 'stand'
    assert load_scenario(parse([]).scenario).robots


@pytest.mark.parametrize('name', [SIM, RECORDER])
def test_a_dead_world_or_recorder_ends_even_a_real_time_run(name):
    run = History(replace(SCENARIO, time='real_time'))
    run.play(1.0)
    run[name].code = 1
    assert run.play(2.0).missing == (name,)


def test_a_run_that_is_done_before_all_are_heard_is_finished_all_the_same():
    run = History()
    run.play(0.1, News())
    run[SIM].code = 0
    assert run.play(1.0, News()).code is Code.FINISHED


# --- what a person sees -------------------------------------------------------------


def heard(name, at, level=Level.OK, **values):
    return Heard(Report(name, level, 'running', {'state': 'running', **values}, 'a1_0'), at)


def test_a_node_whose_diagnostics_stop_is_stale_and_keeps_its_last_figures():
    """A counter that fell to nothing would look like a restart, and be counted twice."""
    last = {WBC: heard(WBC, 10.0, rejected='7'), MPC: heard(MPC, 12.5, rejected='2')}
    wbc, mpc = reports_of_run([WBC, MPC], {}, last, 13.1)
    assert (wbc.level, wbc.message, wbc.values['rejected']) == (Level.STALE, 'silent for 3 s', '7')
    assert mpc == last[MPC].report
    assert (is_told_of(wbc), is_told_of(mpc)) == (True, False)
    assert faults_of_run([wbc, mpc])[0].text == f'{WBC} silent for 3 s'


def test_a_dead_node_is_an_error_in_its_own_name_and_one_that_ended_keeps_its_last_word():
    last = {SIM: heard(SIM, 0.0), MPC: heard(MPC, 0.0)}
    sim, mpc, wbc = reports_of_run([SIM, MPC, WBC], {SIM: -11, MPC: 0}, last, 60.0)
    assert (sim.name, sim.level, sim.message) == (SIM, Level.ERROR, 'was killed by SIGSEGV')
    assert mpc == last[MPC].report
    assert (wbc.level, wbc.values['state']) == (Level.OK, 'starting')
    assert [fault.level for fault in faults_of_run([sim, mpc, wbc])] == [Level.ERROR]


def test_processor_shares_are_differences_over_wall_time():
    assert processor_shares({WBC: 2.0}, {WBC: 3.0, MPC: 9.0}, 4.0) == {WBC: 0.25}


def test_processor_time_of_this_process_agrees_with_the_kernels_own_clock():
    before, told = time.process_time(), processor_time(os.getpid())
    assert told == pytest.approx(before, abs=0.05)  # /proc counts in steps of 10 ms


def test_in_a_pipe_nothing_is_coloured_or_erased():
    stream = io.StringIO()
    printer = Printer(stream, terminal=False, pipe_pause=10.0)
    rows = [row_of(report) for report in reports_of_run([WBC], {}, {}, 0.0)]
    for now in (0.0, 1.0, 2.0, 11.0):
        printer.status(now, progress_line(now, 20.0, 2.0 * now), rows)
    printer.tell(WBC, 'hello')
    printer.end()
    text = stream.getvalue()
    assert '\x1b' not in text
    assert text.count('real-time factor') == 1
    assert f'{WBC}: hello' in text


def test_on_a_terminal_the_block_stays_below_the_lines():
    """Played on a terminal of two escape sequences, only lines and the last block remain."""
    stream = io.StringIO()
    printer = Printer(stream, terminal=True)
    rows = [row_of(report) for report in reports_of_run([WBC, MPC], {}, {}, 0.0)]
    printer.status(0.0, 'progress 0', rows)
    printer.tell(WBC, 'hello')
    printer.status(1.0, 'progress 1', rows)
    screen = _screen(stream.getvalue())
    assert 'hello' in screen[0]
    assert len(screen) == 5
    assert 'progress 1' in screen[4]
    printer.end()
    assert len(_screen(stream.getvalue())) == 1


def _screen(text):
    """Return the lines that a terminal shows after cursor-up and erase-below."""
    lines = ['']
    while text:
        if text.startswith('\x1b['):
            sequence, final = '', ''
            for character in text[2:]:
                if character.isalpha():
                    final = character
                    break
                sequence += character
            text = text[3 + len(sequence) :]
            if final == 'F':
                del lines[len(lines) - 1 - int(sequence) :]
                lines.append('')
            continue
        if text[0] == '\n':
            lines.append('')
        else:
            lines[-1] += text[0]
        text = text[1:]
    return lines[:-1]


@pytest.mark.parametrize(
    ('code', 'words'),
    [
        (0, 'ended'),
        (3, 'gave up waiting (exit 3)'),
        (2, 'failed (exit 2)'),
        (-9, 'was killed by SIGKILL'),
        (-250, 'was killed by signal 250'),
    ],
)
def test_an_exit_is_named(code, words):
    assert describe_exit(code) == words


# --- real processes -----------------------------------------------------------------


TIE = (
    'import os, signal, sys, time\n'
    'from layered_cbf_ros.supervision.parent import tie_to_parent\n'
    'tie_to_parent(os.getppid())\n'
)
STUBBORN = (
    'signal.signal(signal.SIGINT, signal.SIG_IGN)\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n'
)
WAIT = "print('up', flush=True)\ntime.sleep(60)\n"


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a child running some Python, all killed at the end."""
    (tmp_path / 'logs').mkdir()
    children = []

    def start(code, name='/stub', told=None):
        heard = [] if told is None else told
        child = Child(
            ProcessSpec(name, 'stub', ()),
            [sys.executable, '-c', TIE + code],
            tmp_path,
            os.environ,
            lambda name, text: heard.append(text),
        )
        children.append(child)
        return child

    yield start
    for child in children:
        child.send(signal.SIGKILL)
        wait_for(lambda child=child: child.poll() is not None)


def wait_for(condition, limit=20.0):
    """Wait until a condition holds; a loaded machine may take its time."""
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, 'waited in vain'
        time.sleep(0.01)


def is_alive(pid):
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except OSError:
        return False
    return state != 'Z'


def test_a_child_has_a_group_of_its_own_in_our_session(start):
    told = []
    child = start('print(os.getpgid(0), os.getsid(0), flush=True)\n', told=told)
    wait_for(lambda: child.poll() is not None)
    assert told == [f'{child.pid} {os.getsid(0)}']


def test_every_line_is_passed_on_and_logged_even_without_a_newline(start, tmp_path):
    told = []
    child = start(
        "print('one'); print('MISSING /a1_0/ground_force_mpc: nothing on x', file=sys.stderr)\n"
        "sys.stdout.flush(); print('x' * 200_000); print('last', end=''); sys.exit(3)\n",
        told=told,
    )
    wait_for(lambda: child.poll() is not None)
    assert child.poll() == 3
    assert child.missing == MPC
    assert (sorted(told)[0], told[-1]) == ('MISSING /a1_0/ground_force_mpc: nothing on x', 'last')
    assert 'x' * 200_000 in told
    assert (tmp_path / 'logs' / 'stub.log').read_text().endswith('last')


def test_a_crash_is_named_by_its_signal(start):
    child = start('os.kill(os.getpid(), signal.SIGSEGV)\n')
    wait_for(lambda: child.poll() is not None)
    assert describe_exit(child.poll()) == 'was killed by SIGSEGV'


def test_a_real_run_with_a_stubborn_child_ends_and_leaves_no_process(start):
    plan = [ProcessSpec(SIM, 'simulator', ()), ProcessSpec(WBC, 'whole_body_controller', ())]
    codes = {SIM: WAIT, WBC: STUBBORN + WAIT}
    told = {SIM: [], WBC: []}
    supervisor = Supervisor(
        plan,
        lambda spec: start(codes[spec.name], spec.name, told[spec.name]),
        lambda *_: None,
        Patience(interrupt=0.3, terminate=0.3),
    )
    outcomes = []

    def up():
        supervisor.step(time.monotonic(), News())
        return all(told.values())

    wait_for(up)
    pids = [child.pid for child in supervisor.processes.values()]
    supervisor.stop()

    def ended():
        outcomes.append(supervisor.step(time.monotonic(), News()))
        return outcomes[-1] is not None

    wait_for(ended)
    assert outcomes[-1].code is Code.STOPPED
    assert supervisor.processes[SIM].poll() == -signal.SIGINT
    assert supervisor.processes[WBC].poll() == -signal.SIGKILL
    assert not any(is_alive(pid) for pid in pids)


def test_no_orphan_survives_a_killed_supervisor(tmp_path):
    """The kernel itself tells the children, for a killed process can tell nobody."""
    code = (
        'import subprocess, sys, time\n'
        f'child = subprocess.Popen([sys.executable, "-c", {TIE + STUBBORN + WAIT!r}])\n'
        'print(child.pid, flush=True)\n'
        'time.sleep(60)\n'
    )
    with subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, text=True
    ) as supervisor:
        pid = int(supervisor.stdout.readline())
        assert supervisor.stdout.readline() == 'up\n'  # tied by now
        assert is_alive(pid)
        supervisor.kill()
        wait_for(lambda: not is_alive(pid))


def test_the_recorder_gets_time_to_close_its_bag_when_the_supervisor_is_killed():
    plan = {spec.name: node_command(spec, 1) for spec in process_plan(SCENARIO, Path('p'), True)}
    assert f'tie_to_parent(1, {int(signal.SIGTERM)})' in plan[RECORDER][2]
    assert f'tie_to_parent(1, {int(signal.SIGKILL)})' in plan[WBC][2]


def test_a_second_run_in_the_same_domain_is_refused_until_the_first_has_ended(tmp_path):
    code = (
        'import sys, time\nfrom pathlib import Path\n'
        'from layered_cbf_ros.supervision.domain_lock import DomainLock\n'
        f'lock = DomainLock("7", Path({str(tmp_path)!r}))\n'
        'lock.note([Path("/dev/shm/fastrtps_x_el")])\n' + WAIT
    )
    with subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout.readline() == 'up\n'
        with pytest.raises(GraphError, match=f'process {first.pid}'):
            DomainLock('7', tmp_path)
        DomainLock('8', tmp_path).release()
        first.kill()
    lock = DomainLock('7', tmp_path)
    assert lock.leftovers == (Path('/dev/shm/fastrtps_x_el'),)
    lock.release()
    assert DomainLock('7', tmp_path).leftovers == ()


HOLD = (
    'import fcntl\n'
    "for name in ('fastrtps_0123456789abcdef', 'fastrtps_port7411'):\n"
    "    open(f'{folder}/{name}', 'w').close()\n"
    "    open(f'{folder}/sem.{name}_mutex', 'w').close()\n"
    "    lock = os.open(f'{folder}/{name}_el', os.O_RDWR | os.O_CREAT)\n"
    '    fcntl.flock(lock, fcntl.LOCK_EX)\n'
)


def test_shared_memory_of_a_killed_child_is_removed_and_no_other(start, tmp_path, monkeypatch):
    folder = tmp_path / 'shm'
    folder.mkdir()
    foreign = folder / 'fastrtps_feedfeedfeedfeed_el'
    foreign.touch()
    monkeypatch.setattr(shared_memory, 'FOLDER', folder)
    told = []
    child = start(f'folder = {str(folder)!r}\n' + HOLD + WAIT, told=told)
    wait_for(lambda: child.poll() is None and told)
    assert len(shared_memory.held_by(child.pid)) == 2
    assert shared_memory.remove(shared_memory.held_by(child.pid)) == 0  # they are in use
    child.send(signal.SIGKILL)
    wait_for(lambda: child.poll() is not None)
    assert list(folder.iterdir()) == [foreign]


def test_ports_of_our_domain_that_nobody_maps_are_removed(tmp_path, monkeypatch):
    """One port is in our memory, one in nobody's, one is of another domain."""
    monkeypatch.setattr(shared_memory, 'FOLDER', tmp_path)
    used, free, foreign = (tmp_path / f'fastrtps_port{7400 + n}' for n in (251, 253, 501))
    for port in (used, free, foreign):
        port.write_bytes(bytes(4096))
    mutex = tmp_path / f'sem.{free.name}_mutex'
    mutex.touch()
    with used.open('r+b') as file, mmap.mmap(file.fileno(), 4096):
        assert shared_memory.remove_ports(1) == 1
    assert used.exists()
    assert foreign.exists()
    assert not free.exists()
    assert not mutex.exists()


def test_a_pad_s_preset_becomes_the_coordinator_s_and_a_wrong_one_is_named():
    folder = find_folder('params') / 'joystick'
    chosen = with_joystick(load_scenario('stand'), folder, 'ps5')
    told = read_parameter_file(folder / 'ps5.yaml')['coordinator']
    assert told['all_button'] != JoystickParameters().all_button
    assert told.items() <= chosen.parameters['coordinator'].items()
    defaults = read_defaults(find_folder('params'))
    values = run_parameters(chosen, defaults, Path('world.json'), None)['/coordinator']
    assert values['all_button'] == told['all_button']
    with pytest.raises(ParameterError, match=r"no pad 'ps6'; did you mean .*there are"):
        with_joystick(load_scenario('stand'), folder, 'ps6')
