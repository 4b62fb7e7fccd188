"""What is re-solved is what ran, to the bit; what would have been obeys physics."""

from __future__ import annotations

import dataclasses
import json
import math
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from layered_cbf_ros.bags.resolving.command_line import main
from layered_cbf_ros.bags.resolving.resolving import shared_out
from layered_cbf_ros.bags.resolving.rows import same_bits
from layered_cbf_ros.bags.resolving.ticks import LockstepTicks, RealTimeTicks
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError, LayeredCbfError
from layered_cbf_ros.interfaces import NS_PER_S, RobotState
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.node_parameters import parameter_names
from layered_cbf_ros.resources import find_folder
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Desired, Rates, Robot, Scenario
from layered_cbf_ros.scenario_file import to_json
from layered_cbf_ros.supervision.run_parameters import explicit, read_defaults
from layered_cbf_ros.timing import InputRule

MS = 1_000_000
STAMP_AT = 4  # offset of the stamp in a message with a header [byte]
RADIUS, GAP = 0.3, 3.0
RATE = 250
COORDINATOR, MPC, WBC = 'coordinator', 'a1_0/ground_force_mpc', 'a1_0/whole_body_controller'
COMMANDS, FORCES = '/a1_0/joint_commands', '/a1_0/ground_forces'
SAFE = '/safe_trajectory'
STORE = get_typestore(Stores.ROS2_JAZZY)

Change = Callable[[str, int, bytes], bytes | None]


def stamp_in(data: bytes) -> int:
    seconds, nanoseconds = struct.unpack_from('<iI', data, STAMP_AT)
    return seconds * NS_PER_S + nanoseconds


def copied(source: Path, target: Path, change: Change) -> Path:
    """Copy a bag message by message; what `change` returns None for is left out."""
    ids: dict[str, int] = {}
    with (source / 'bag' / 'bag_0.mcap').open('rb') as stream, BagWriter(target) as bag:
        for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            head = stamp_in(message.data) if len(message.data) >= 12 else 0
            data = change(channel.topic, head, message.data)
            if data is None:
                continue
            if channel.topic not in ids:
                qos = channel.metadata['offered_qos_profiles']
                ids[channel.topic] = bag.add_topic(channel.topic, schema.name, qos)
            bag.write(ids[channel.topic], data, message.log_time, message.publish_time)
    return target


def figures(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict]:
    """Return the exit code of re_solve, and its JSON."""
    code = main([*map(str, arguments), '--json'])
    return code, json.loads(capsys.readouterr().out)


def topics_of(result: dict) -> dict[str, dict]:
    return {topic['topic']: topic for node in result['nodes'] for topic in node['topics']}


def gains(tmp_path: Path, node: str, **values: object) -> Path:
    file = tmp_path / 'gains.yaml'
    file.write_text(json.dumps({node: {'ros__parameters': values}}))
    return file


def messages(bag: Path, topic: str) -> Iterator[object]:
    """Yield the messages of a topic as rosbags reads them."""
    with AnyReader([bag]) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        for connection, _, data in reader.messages(wanted):
            yield reader.deserialize(data, connection.msgtype)


# A run of two robots who want to change places, of which only the states were recorded.


def head_on(goal_y: float = 0.0) -> Scenario:
    robots = (
        Robot('a1_0', (-GAP / 2, 0.0), 0.0, desired=Desired(goal=(GAP / 2, goal_y))),
        Robot('a1_1', (GAP / 2, 0.0), math.pi, desired=Desired(goal=(-GAP / 2, goal_y))),
    )
    rates = Rates(RATE, RATE, 50)
    bare = Scenario(
        'head_on', '', 0, 9.0, 'lockstep', 'bullet', 0.2, robots, rates=rates, parameters={}
    )
    return explicit(bare, read_defaults(find_folder('params')))


def recorded_states(folder: Path, scenario: Scenario, left_out: tuple[int, ...] = ()) -> Path:
    """Write a bag in which all robots stand at their start all the time."""
    model, writer = RobotModel(), StateWriter([robot.name for robot in scenario.robots])
    poses = [model.nominal_configuration(np.array(r.position), r.yaw) for r in scenario.robots]
    text = STORE.types['std_msgs/msg/String'](data=to_json(scenario))
    period = NS_PER_S // scenario.rates.state
    with BagWriter(folder) as bag:
        told = bag.add_topic('/scenario', 'std_msgs/msg/String')
        bag.write(told, bytes(STORE.serialize_cdr(text, 'std_msgs/msg/String')), 0, 0)
        states = bag.add_topic('/state', 'sensor_msgs/msg/JointState')
        for stamp in range(0, round(scenario.duration * NS_PER_S) + 1, period):
            still = [
                RobotState(stamp, pose, np.zeros(18), np.zeros(12), np.zeros(4)) for pose in poses
            ]
            if stamp not in left_out:
                bag.write(states, writer.encode(still), stamp + 1, stamp)
    return folder


@pytest.fixture(scope='module')
def states(tmp_path_factory) -> Path:
    return recorded_states(tmp_path_factory.mktemp('states') / 'bag', head_on())


def plan_of(result: dict) -> dict:
    (node,) = result['nodes']
    return node['plan']['resolved']


def unfiltered_path(start: float, goal: float, duration: float) -> list[float]:
    """Roll the law of the desired motion out for one robot on a line, by plain arithmetic.

    u = beta_2 (target - v) within the limits, with target = (beta_1 / beta_2) (goal - x),
    at most 0.5 m/s and faded in over the first second; beta = (1, 2).
    """
    x, v, dt, path = start, 0.0, 1.0 / RATE, []
    for tick in range(round(duration * RATE) + 1):
        path.append(x)
        target = max(-0.5, min(0.5, 0.5 * (goal - x))) * min(1.0, tick * dt)
        u = max(-1.5, min(1.5, 2.0 * (target - v)))
        x, v = x + dt * v + 0.5 * dt * dt * u, v + dt * u
    return path


def test_without_the_filter_robots_that_change_places_run_into_each_other(states, tmp_path, capsys):
    """When, how near and how deep agrees with a roll-out that knows nothing of the package."""
    keep_left_out = gains(tmp_path, COORDINATOR, keep_right_angle=0.0)
    code, result = figures(capsys, states, '--filter', 'off', '--params', keep_left_out)
    left = np.array(unfiltered_path(-GAP / 2, GAP / 2, 9.0))
    distance = np.abs(2.0 * left)  # the other one comes from the mirror image
    inside = np.flatnonzero(distance < 2 * RADIUS) / RATE
    (overlap,) = plan_of(result)['overlaps']
    assert code == 1
    assert overlap['pair'] == 'a1_0~a1_1'
    assert overlap['begin_s'] == pytest.approx(inside[0], abs=1.5 / RATE)
    assert overlap['end_s'] == pytest.approx(inside[-1], abs=1.5 / RATE)
    # Inputs are rounded to 1e-6 m/s^2, which over 9 s makes less than 0.1 mm.
    assert overlap['depth_m'] == pytest.approx(2 * RADIUS - distance.min(), abs=1e-4)
    assert plan_of(result)['intervention']['value'] < 1e-6
    length = left[-1] - left[0]
    assert plan_of(result)['paths_m']['a1_0'] == pytest.approx(length, abs=1e-4)


def test_with_the_filter_they_keep_what_was_promised(states, tmp_path, capsys):
    """The same wishes, filtered, come no nearer than the sum of the radii."""
    straight = gains(tmp_path, COORDINATOR, keep_right_angle=0.0)
    code, result = figures(capsys, states, COORDINATOR, '--params', straight)
    plan = plan_of(result)
    assert code == 0
    assert not plan['overlaps']
    assert plan['approaches']['a1_0~a1_1']['distance_m'] >= 2 * RADIUS - 1e-3
    assert plan['intervention']['value'] > 0.1


def test_larger_robots_keep_a_larger_distance(states, tmp_path, capsys):
    nearest = []
    for radius in (RADIUS, 0.5):
        file = gains(tmp_path, COORDINATOR, agent_radius=radius)
        code, result = figures(capsys, states, COORDINATOR, '--params', file)
        approach = plan_of(result)['approaches']['a1_0~a1_1']
        assert code == 0
        assert approach['promised_m'] == pytest.approx(2 * radius)
        nearest.append(approach['distance_m'])
    assert nearest[1] > nearest[0] + 0.1
    assert nearest[1] >= 1.0 - 1e-3


def test_a_slower_decay_intervenes_earlier(states, tmp_path, capsys):
    """psi1 = h' + alpha1 h is the smaller, the smaller alpha1; read from the written bag."""
    begins = []
    for alpha1 in (0.82, 0.4):
        out = tmp_path / f'alpha_{alpha1}'
        file = gains(tmp_path, COORDINATOR, alpha1=alpha1)
        assert main([str(states), '--params', str(file), COORDINATOR, '--output', str(out)]) == 0
        ticks = [
            stamp_of_point(message, point)
            for message in messages(out, '/coordinator/intervention')
            for point in message.points
            if max(point.positions) > 0.05
        ]
        begins.append(min(ticks))
    capsys.readouterr()
    assert begins[1] < begins[0] - NS_PER_S // 10


def stamp_of_point(message, point) -> int:
    stamp, after = message.header.stamp, point.time_from_start
    return (stamp.sec + after.sec) * NS_PER_S + stamp.nanosec + after.nanosec


def test_written_bag_holds_the_plan_and_the_changed_gains(states, tmp_path, capsys):
    """Every tick of the run is in it, in the run's own form; it isn't overwritten."""
    out = tmp_path / 'out'
    file = gains(tmp_path, COORDINATOR, alpha1=0.5)
    command = [str(states), COORDINATOR, '--params', str(file), '--output', str(out)]
    assert main(command) == 0
    plans = list(messages(out, SAFE))
    (scenario,) = messages(out, '/scenario')
    assert len(plans) == 9 * RATE + 1
    assert plans[0].joint_names == ['a1_0', 'a1_1']
    assert json.loads(scenario.data)['parameters'][COORDINATOR]['alpha1'] == 0.5
    points = sum(len(m.points) for m in messages(out, '/coordinator/desired'))
    assert points == 9 * RATE + 1
    with pytest.raises(BagError, match='exists'):
        main(command)
    assert main([*command, '--force']) == 0
    with pytest.raises(BagError, match='where the recording is'):
        main([*command[:-1], str(states), '--force'])
    capsys.readouterr()


@pytest.mark.parametrize(
    ('node', 'values', 'told'),
    [
        (COORDINATOR, {'alfa1': 0.5}, "no parameter 'alfa1'; did you mean 'alpha1'"),
        (COORDINATOR, {'alpha1': 99.0}, 'alpha1 is 99; keep it in'),
        (COORDINATOR, {'alpha1': 'much'}, "alpha1 is 'much'; give a number"),
        (COORDINATOR, {'state_rate': 500}, 'recorded with 250'),
        ('cordinator', {'alpha1': 0.5}, "no node 'cordinator'; did you mean 'coordinator'"),
        (WBC, {'torque_limit': 5.0}, f'says nothing of {COORDINATOR}'),
    ],
)
def test_wrong_gains_are_named_in_one_line(states, tmp_path, node, values, told):
    file = gains(tmp_path, node, **values)
    with pytest.raises(LayeredCbfError, match=told) as caught:
        main([str(states), COORDINATOR, '--params', str(file)])
    assert str(file) in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (['nobody'], "no node 'nobody'; there are coordinator, a1_0/ground_force_mpc"),
        ([MPC, '--filter', 'off'], 'leave a1_0/ground_force_mpc out'),
        ([MPC], f'has no {SAFE}: {MPC} acts on it'),
        ([COORDINATOR], 'holds no output to compare with'),
        ([COORDINATOR, '--output', 'x.mcap'], 'must be the folder'),
    ],
)
def test_what_the_bag_cannot_answer_is_one_clear_line(states, arguments, told):
    with pytest.raises(LayeredCbfError, match=told) as caught:
        main([str(states), *arguments])
    assert '\n' not in str(caught.value)


def test_a_missing_state_is_named_with_its_stamp(tmp_path):
    hole = 2 * NS_PER_S
    bag = recorded_states(tmp_path / 'bag', head_on(), left_out=(hole,))
    with pytest.raises(BagError, match=r'/state lacks stamp 2\.000 s'):
        main([str(bag), '--filter', 'off'])


def test_a_scenario_without_a_gain_is_refused_by_name(tmp_path):
    whole = head_on()
    parameters = {kind: dict(values) for kind, values in whole.parameters.items()}
    del parameters[COORDINATOR]['alpha2']
    scenario = dataclasses.replace(whole, parameters=parameters, duration=0.1)
    bag = recorded_states(tmp_path / 'bag', scenario)
    with pytest.raises(BagError, match=r'no coordinator\.alpha2'):
        main([str(bag), '--filter', 'off'])


def test_no_node_has_a_parameter_that_turns_the_filter_off():
    """It must not be off on robots by accident."""
    names = parameter_names(COORDINATOR)
    assert not [name for name in names if 'filter' in name]


def test_no_ros_is_needed(states):
    """A process in which no ROS package can be imported answers all the same."""
    block = 'import sys\nfor n in ("rclpy", "std_msgs", "sensor_msgs", "trajectory_msgs"):\n'
    block += '    sys.modules[n] = None\n'
    block += 'from layered_cbf_ros.bags.resolving.command_line import main\n'
    block += 'sys.exit(main(sys.argv[1:]))'
    command = [sys.executable, '-c', block, str(states), '--filter', 'off']
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert 'ANSWERED' in done.stdout, done.stderr


# Which inputs make a tick.


def record(stamp_ns: int) -> Record:
    return Record(Topic('/state', '', ''), stamp_ns, stamp_ns, b'')


def test_a_lockstep_tick_has_the_stamps_of_its_rules_whatever_their_order_in_the_bag():
    rule = InputRule(period_ns=2 * MS, latency_ns=MS, age_limit_ns=50 * MS)
    ticks = LockstepTicks('node', '/state', MS, {'/plan': rule})
    for stamp in (0, 2, 1, 3):
        ticks.offer('/state', stamp * MS, record(stamp * MS))
    for stamp in (2, 0):
        ticks.offer('/plan', stamp * MS, stamp)
    found = [(tick.stamp_ns // MS, tick.inputs['/plan']) for tick in ticks.due()]
    assert found == [(0, None), (1, 0), (2, 0), (3, 2)]


def test_a_real_time_tick_has_the_newest_input_that_had_come():
    rule = InputRule(period_ns=2 * MS, latency_ns=MS, age_limit_ns=50 * MS)
    ticks = RealTimeTicks('/state', {'/plan': rule}, {})
    ticks.offer('/state', 10 * MS, record(10 * MS), 110 * MS)
    for stamp, log in ((6, 107), (8, 109), (10, 111)):
        ticks.offer('/plan', stamp * MS, stamp, log * MS)
    ticks.sent(10 * MS, sent_ns=110 * MS)
    (tick,) = ticks.due()
    assert tick.inputs['/plan'] == 8
    ticks.offer('/state', 90 * MS, record(90 * MS), 190 * MS)
    ticks.sent(90 * MS, sent_ns=191 * MS)
    (late,) = ticks.due()
    assert late.inputs['/plan'] is None  # 80 ms old, and 50 ms is the limit


def test_processes_share_the_nodes_and_leave_none_out():
    nodes = [COORDINATOR, *(f'a1_{k}/{n}' for k in range(4) for n in ('ground_force_mpc',))]
    shares = shared_out(nodes, 3)
    assert len(shares) == 3
    assert sorted(node for share in shares for node in share) == sorted(nodes)


def test_the_sign_of_zero_is_a_bit():
    assert same_bits(np.array([0.0, 1.0, math.nan]), np.array([-0.0, 1.0, math.nan])).tolist() == [
        False,
        True,
        True,
    ]


# A real run of the whole node graph.


@pytest.fixture(scope='module')
def run(tmp_path_factory) -> Path:
    pytest.importorskip('rclpy')
    from live_run import LiveRun

    output = tmp_path_factory.mktemp('run') / 'run'
    live = LiveRun('one_agent_three_obstacles', output, '--duration', '1.5')
    live.end()
    live.process.stdout.close()
    assert (output / 'bag' / 'bag_0.mcap').exists(), live.said
    return output


@pytest.mark.lockstep
def test_every_output_of_every_node_comes_out_the_same_to_the_bit(run, capsys):
    """As many are compared as mcap and rosbags count in the bag."""
    code, result = figures(capsys, run)
    assert code == 0
    assert result['bit_equal']
    assert [node['node'] for node in result['nodes']] == [COORDINATOR, 'obstacle_tracker', MPC, WBC]
    with (run / 'bag' / 'bag_0.mcap').open('rb') as stream:
        counts: dict[str, int] = {}
        for _, channel, _ in make_reader(stream).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    topics = topics_of(result)
    for topic in (SAFE, FORCES, COMMANDS, '/obstacles/tracks'):
        assert topics[topic]['compared'] + topics[topic]['repeated'] == counts[topic] > 100
    for topic in ('/coordinator/barriers', '/coordinator/desired', '/coordinator/intervention'):
        points = sum(len(message.points) for message in messages(run / 'bag', topic))
        assert topics[topic]['compared'] + topics[topic]['repeated'] == points > 1000


@pytest.mark.lockstep
def test_one_changed_bit_is_found_at_its_stamp(run, tmp_path, capsys):
    """The last bit of one torque: the difference is that of two neighbouring doubles."""
    where, changed = 700 * MS, []

    def flip(topic: str, stamp: int, data: bytes) -> bytes:
        if topic != COMMANDS or stamp != where:
            return data
        (old,) = struct.unpack_from('<d', data, len(data) - 8)
        new = np.nextafter(old, math.inf)
        changed.append(abs(new - old))
        return data[:-8] + struct.pack('<d', new)

    bag = copied(run, tmp_path / 'bag', flip)
    code, result = figures(capsys, bag)
    assert code == 1
    topic = topics_of(result)[COMMANDS]
    assert topic['compared'] - topic['bit_equal'] == 1
    assert topic['first_different_ns'] == where
    (quantity,) = topic['quantities']
    assert (quantity['quantity'], quantity['unit'], quantity['different']) == ('torque', 'Nm', 1)
    assert (quantity['name'], quantity['stamp_ns']) == ('RR_lower_joint', where)
    assert quantity['largest'] == changed[0] > 0.0
    others = [t for name, t in topics_of(result).items() if name != COMMANDS]
    assert all(t['compared'] == t['bit_equal'] for t in others)


@pytest.mark.lockstep
def test_a_changed_barrier_is_found_in_its_batch(run, tmp_path, capsys):
    kind, spoilt = 'trajectory_msgs/msg/JointTrajectory', []

    def spoil(topic: str, stamp: int, data: bytes) -> bytes:
        if topic != '/coordinator/barriers' or stamp < 400 * MS or spoilt:
            return data
        message = STORE.deserialize_cdr(data, kind)
        point = message.points[3]
        point.positions = point.positions + 0.25 * (np.arange(len(point.positions)) == 0)
        spoilt.append(stamp_of_point(message, point))
        return bytes(STORE.serialize_cdr(message, kind))

    code, result = figures(capsys, copied(run, tmp_path / 'bag', spoil), COORDINATOR)
    (quantity,) = topics_of(result)['/coordinator/barriers']['quantities']
    assert code == 1
    assert (quantity['quantity'], quantity['stamp_ns']) == ('psi0', spoilt[0])
    assert quantity['largest'] == pytest.approx(0.25, abs=1e-12)


@pytest.mark.lockstep
def test_an_output_that_is_missing_in_between_is_a_difference(run, tmp_path, capsys):
    def drop(topic: str, stamp: int, data: bytes) -> bytes | None:
        return None if topic == COMMANDS and stamp == 500 * MS else data

    code, result = figures(capsys, copied(run, tmp_path / 'bag', drop), WBC)
    assert code == 1
    assert topics_of(result)[COMMANDS]['resolved_only'] == 1


@pytest.mark.lockstep
def test_a_missing_input_is_one_line_and_code_two(run, tmp_path):
    """As a user sees it: the program itself, its error stream and its exit code."""

    def drop(topic: str, stamp: int, data: bytes) -> bytes | None:
        return None if topic == SAFE and stamp == 500 * MS else data

    bag = copied(run, tmp_path / 'bag', drop)
    program = 'from layered_cbf_ros.nodes.re_solve import main; main()'
    command = [sys.executable, '-c', program, str(bag), MPC]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith('ERROR /safe_trajectory lacks stamp 0.500 s')
    no_plan = copied(run, tmp_path / 'none', lambda topic, _, data: None if topic == SAFE else data)
    with pytest.raises(BagError, match='has no /safe_trajectory'):
        main([str(no_plan), WBC])


@pytest.mark.lockstep
def test_a_bag_that_starts_in_the_middle_says_what_it_cannot_know(run, tmp_path, capsys):
    """The plan's velocity is memory: a coordinator that starts anew starts at rest."""
    begin = 700 * MS

    def late(topic: str, stamp: int, data: bytes) -> bytes | None:
        return data if topic == '/scenario' or stamp >= begin else None

    bag = copied(run, tmp_path / 'bag', late)
    assert main([str(bag), COORDINATOR]) == 1
    assert 'starts in the middle of the run' in capsys.readouterr().out
    _, result = figures(capsys, bag, COORDINATOR)
    (node,) = result['nodes']
    worst = {q['quantity']: q for q in topics_of(result)[SAFE]['quantities']}
    assert not node['from_start']
    assert worst['velocity']['largest'] > 0.05


@pytest.mark.lockstep
def test_what_is_whole_of_a_cut_bag_is_compared(run, tmp_path, capsys):
    data = (run / 'bag' / 'bag_0.mcap').read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[: int(0.7 * len(data))])
    code, result = figures(capsys, cut)
    assert code == 0
    assert result['truncated']
    assert topics_of(result)[COMMANDS]['compared'] > 300


@pytest.mark.lockstep
def test_in_real_time_inputs_are_guessed_and_the_report_says_so(run, tmp_path, capsys):
    """The tracker takes what comes, so there is nothing to guess; the others differ a little."""
    text = 'std_msgs/msg/String'

    def hasten(topic: str, _: int, data: bytes) -> bytes:
        if topic != '/scenario':
            return data
        scenario = json.loads(STORE.deserialize_cdr(data, text).data) | {'time': 'real_time'}
        message = STORE.types[text](data=json.dumps(scenario))
        return bytes(STORE.serialize_cdr(message, text))

    bag = copied(run, tmp_path / 'bag', hasten)
    code = main([str(bag)])
    assert 'is not recorded; the newest are taken' in capsys.readouterr().out
    _, result = figures(capsys, bag)
    topics = topics_of(result)
    assert code in (0, 1)
    assert topics['/obstacles/tracks']['compared'] == topics['/obstacles/tracks']['bit_equal'] > 100
    assert topics[COMMANDS]['compared'] > 1000
    torque = [q for q in topics[COMMANDS]['quantities'] if q['quantity'] == 'torque']
    assert all(q['largest'] <= 2 * 33.5 for q in torque)


@pytest.mark.lockstep
def test_gains_as_they_were_give_the_run_again(run, tmp_path, capsys):
    """The run's own parameter file changes nothing, even where robots follow exactly."""
    code, result = figures(capsys, run, '--params', run / 'params.yaml')
    assert code == 0
    assert result['bit_equal']
    plan = result['nodes'][0]['plan']
    assert plan['apart']['value'] == 0.0
    old, new = plan['recorded'], plan['resolved']
    assert new['paths_m'] == old['paths_m']
    assert new['approaches'] == old['approaches']


@pytest.mark.lockstep
def test_weaker_joints_get_no_more_torque_than_they_bear(run, tmp_path, capsys):
    limit, out = 4.0, tmp_path / 'out'
    file = gains(tmp_path, 'whole_body_controller', torque_limit=limit)
    assert main([str(run), '--params', str(file), '--output', str(out)]) == 0
    old, new = (
        np.array([message.effort for message in messages(bag, COMMANDS)])
        for bag in (run / 'bag', out)
    )
    capsys.readouterr()
    assert np.abs(old).max() > limit + 1.0
    assert np.abs(new).max() <= limit + 1e-3
    assert len(new) == len(old)


@pytest.mark.lockstep
def test_differences_of_forces_are_those_of_plain_arithmetic(run, tmp_path, capsys):
    """Mean, RMS and largest, from both bags as rosbags reads them."""
    out = tmp_path / 'out'
    file = gains(tmp_path, MPC, max_normal_force=45.0)
    code, result = figures(capsys, run, MPC, '--params', file, '--output', out)
    old, new = (
        np.array([message.effort[:12] for message in messages(bag, FORCES)])
        for bag in (run / 'bag', out)
    )
    found = {q['quantity']: q for q in topics_of(result)[FORCES]['quantities']}['force']
    assert code == 0
    assert new[:, 2::3].max() <= 45.0 + 1e-3 < old[:, 2::3].max()
    assert found['largest'] == pytest.approx(np.abs(new - old).max(), rel=1e-12)
    assert found['mean'] == pytest.approx(np.abs(new - old).mean(), rel=1e-9)
    assert found['rms'] == pytest.approx(np.sqrt(((new - old) ** 2).mean()), rel=1e-9)
