"""Nodes that are fed from a bag do again what they did in the run."""

from __future__ import annotations

import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseArray
from live_node import LiveNode
from live_replay import LiveReplay
from live_run import LiveRun
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory

from layered_cbf_ros.node_topics import asked_on, inputs_of
from layered_cbf_ros.nodes.message_types import message_class

pytestmark = pytest.mark.system

S = 1_000_000_000
PLAN, ROBOT = '/safe_trajectory', 'a1_0'
SCENARIO = f"""
description: One A1 meets an obstacle that comes towards it.
duration: 3.0
robots:
  - name: {ROBOT}
    position: [0.0, 0.0]
    desired: {{goal: [4.0, 0.0]}}
obstacles:
  - name: cart
    radius: 0.3
    motion: {{line: {{start: [2.2, 0.1], end: [-2.0, 0.1], speed: 0.4}}}}
"""
NODES = {
    'coordinator': (PLAN, MultiDOFJointTrajectory),
    'obstacle_tracker': ('/obstacles/tracked', PoseArray),
    f'{ROBOT}/ground_force_mpc': (f'/{ROBOT}/ground_forces', JointState),
    f'{ROBOT}/whole_body_controller': (f'/{ROBOT}/joint_commands', JointState),
}
OF_EVERY_NODE = {'/parameter_events', '/rosout'}
QUIET_S = 2.0  # on a loaded machine topics of one node are found one after the other
UNASKED = set(asked_on([ROBOT]))  # nobody steers in this run
STORE = get_typestore(Stores.ROS2_JAZZY)
# In real time tracks are used as soon as they come, in lockstep a detection period (10 ms)
# later: robot and cart, which meet at 0.9 m/s, then see each other 9 mm nearer, and the
# plan answers with a part of that.
REAL_TIME_BOUND = 0.005


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """A short run, and its bag as rosbags decodes it: by topic, message by stamp."""
    folder = tmp_path_factory.mktemp('fed')
    (folder / 'scenario.yaml').write_text(SCENARIO)
    run = LiveRun(folder / 'scenario.yaml', folder / 'run')
    run.end()
    assert run.summary()['outcome'] == 'finished', run.said
    return folder / 'run'


def recorded(run, topic):
    found = {}
    with AnyReader([run / 'bag'], default_typestore=STORE) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        for connection, _, data in reader.messages(connections):
            message = reader.deserialize(data, connection.msgtype)
            found[stamp_ns(message)] = message
    return found


def stamp_ns(message) -> int:
    return message.header.stamp.sec * S + message.header.stamp.nanosec


def numbers(message) -> np.ndarray:
    """Return all numbers of a message that tell what the node decided."""
    if hasattr(message, 'effort'):
        return np.array([message.position, message.velocity, message.effort])
    if hasattr(message, 'poses'):
        return np.array([[pose.position.x, pose.position.y] for pose in message.poses])
    return np.array(
        [[t.translation.x, t.translation.y] for t in message.points[0].transforms]
        + [[v.linear.x, v.linear.y] for v in message.points[0].velocities]
        + [[a.linear.x, a.linear.y] for a in message.points[0].accelerations]
    )


def start(node: str, run, mode: str) -> LiveNode:
    """Start a node by hand, with what a person would type."""
    robot, _, executable = node.rpartition('/')
    namespace = ('-r', f'__ns:=/{robot}') if robot else ()
    return LiveNode(executable, '--params-file', str(run / 'params.yaml'), *namespace,
                    '-p', f'time:={mode}')  # fmt: skip


def listen_to_others(live: LiveNode, node: str, run) -> set[str]:
    """Subscribe to every recorded topic that the live node itself doesn't send.

    Returns:
        The topics that a message has come of; it fills while the test's node is served.
    """
    robot, _, executable = node.rpartition('/')
    own: set[str] = set()
    changed = time.monotonic()

    def all_known() -> bool:
        """Tell whether its topics are there, and for a while no more have turned up."""
        nonlocal changed
        known = len(own)
        if executable in live.node.get_node_names():
            found = live.node.get_publisher_names_and_types_by_node(executable, f'/{robot}')
            own.update(name for name, _ in found)
        if len(own) > known:
            changed = time.monotonic()
        quiet = time.monotonic() - changed > QUIET_S
        return quiet and {NODES[node][0], '/diagnostics', '/ready'} <= own

    live.until(all_known)
    with AnyReader([run / 'bag'], default_typestore=STORE) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections}
    heard: set[str] = set()
    loose = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    for topic in kinds.keys() - own - OF_EVERY_NODE:
        live.node.create_subscription(
            message_class(kinds[topic]),
            topic,
            lambda _, topic=topic: heard.add(topic),
            loose,
            raw=True,
        )
    return heard


def feed(node: str, run, mode: str, *options: str):
    """Feed a live node; return its answers by stamp, all topics heard, and what replay said."""
    topic, kind = NODES[node]
    live = start(node, run, mode)
    answers = {}
    ears = live.node.create_subscription(
        kind, topic, lambda m: answers.setdefault(stamp_ns(m), m), QoSProfile(depth=5000)
    )
    live.until(lambda: ears.handle.get_publisher_count() == 1)
    sent = listen_to_others(live, node, run)
    replay = LiveReplay(run, '--inputs-of', node, '-d', '2', *options)
    try:
        live.until(lambda: replay.process.poll() is not None)
        code, output, errors = replay.end()
        assert code == 0, errors
        live.until(lambda: f'answered {len(answers)} times' in output)
    finally:
        replay.close()
        live.stop()
    return answers, sent, output


@pytest.mark.parametrize('node', NODES)
def test_a_node_in_lockstep_repeats_its_run_to_the_bit(run, node):
    """However it is hurried: at ten times the speed nothing is lost."""
    answers, sent, output = feed(node, run, 'lockstep', '-r', '10')
    expected = recorded(run, NODES[node][0])
    assert len(answers) >= len(expected) - 5
    for stamp, message in answers.items():
        if stamp in expected:
            assert np.array_equal(numbers(message), numbers(expected[stamp])), stamp
    assert sent == set(inputs_of(node, [ROBOT])) - UNASKED
    assert f'/{node} answered' in output


def test_a_coordinator_in_real_time_plans_as_it_did(run):
    """It uses the newest tracks, so its plan is near the recorded one, not the same."""
    expected = recorded(run, PLAN)
    answers, sent, _ = feed('coordinator', run, 'real_time')
    common = sorted(set(answers) & set(expected))
    assert len(common) > 0.95 * len(expected)
    gaps = [numbers(answers[t])[0] - numbers(expected[t])[0] for t in common]
    assert np.abs(gaps).max() < REAL_TIME_BOUND
    assert sent == set(inputs_of('coordinator', [ROBOT])) - UNASKED
    # the obstacle mattered: the robot left the straight line that it was told to walk
    sideways = [numbers(message)[0, 1] for message in expected.values()]
    assert np.abs(sideways).max() > 10 * REAL_TIME_BOUND, max(sideways)


@pytest.mark.parametrize('node', [*NODES, 'simulator'])
def test_inputs_are_what_the_live_node_subscribes_to(run, node):
    live = start(node, run, 'real_time')
    robot, _, executable = node.rpartition('/')
    wanted = set(inputs_of(node, [ROBOT]))
    of_tools = {'/ready', '/recorder/progress'}  # only in a run, where the simulator waits

    def found() -> set[str]:
        if executable not in live.node.get_node_names():
            return set()
        names = live.node.get_subscriber_names_and_types_by_node(executable, f'/{robot}')
        return {name for name, _ in names} - OF_EVERY_NODE - of_tools

    live.until(lambda: found() == wanted)
    live.stop()


def test_a_node_that_was_not_in_the_run_is_named(run):
    code, _, errors = LiveReplay(run, '--inputs-of', f'{ROBOT}/coordinator').end()
    assert code == 2
    assert f"no node '{ROBOT}/coordinator'" in errors[-1]
