"""The state estimator as a process: in a lockstep run, and before real sensors."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseStamped
from live_node import ENVIRONMENT, LiveNode
from live_run import LiveRun
from nav_msgs.msg import Odometry
from sensed import errors
from sensor_msgs.msg import JointState

from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.interfaces import GRAVITY, Measured
from layered_cbf_ros.messages.ground_forces import GroundForceReader
from layered_cbf_ros.messages.measured import MeasuredReader, MeasuredWriter
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.messages.standard import header
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.state_estimator import StateEstimator
from layered_cbf_ros.timing import InputRules, TimingParameters

pytestmark = pytest.mark.system

MS = 1_000_000
RUN = """
description: One A1 begins to walk by what its sensors tell.
duration: 1.2
states: estimator
robots:
  - name: a1_0
    position: [0.5, -0.3]
    yaw: 0.5
    desired: {frame: body, velocity: [{at: 0.0, x: 0.3}]}
emulation: {encoder_velocity_noise: 0.05, gyro_bias: 0.002, accelerometer_bias: 0.05,
  tilt_bias: 0.003, foot_force_noise: 3.0, foot_force_offset: 10.0}
"""


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return a run in lockstep, ended, and the messages of each topic by their stamps."""
    folder = tmp_path_factory.mktemp('estimated')
    scenario = folder / 'scenario.yaml'
    scenario.write_text(RUN)
    run = LiveRun(scenario, folder / 'run')
    assert run.end() == 0, run.said
    readers = {
        '/state': StateReader('a1_0'),
        '/a1_0/state': StateReader('a1_0'),
        '/a1_0/measured': MeasuredReader(),
        '/a1_0/ground_forces': GroundForceReader(),
    }
    messages = {topic: {} for topic in readers}
    for record in BagReader(folder / 'run' / 'bag').records(list(readers)):
        message = readers[record.topic.name].read(record.data)
        messages[record.topic.name][message.stamp_ns] = message
    return run, messages


def test_one_word_feeds_the_layers_by_the_estimate(run):
    """Every state of the truth has its estimate, from the first on, at the scenario's pose."""
    live, messages = run
    assert live.summary()['passed'], live.said
    truth, states = (list(messages[topic].values()) for topic in ('/state', '/a1_0/state'))
    assert list(messages['/a1_0/state']) == [tick * MS for tick in range(1201)]
    wrong = errors(states, truth)
    assert wrong.walked > 0.1
    assert wrong.drift < 2e-3
    assert wrong.height < 2e-3
    np.testing.assert_allclose(states[0].configuration, truth[0].configuration, atol=5e-3)


def test_estimates_follow_to_the_bit_from_what_was_measured(run):
    """With the gait of its own stamp minus two ticks, whatever the machine's load was."""
    _, messages = run
    start = {'start_x': 0.5, 'start_y': -0.3, 'start_yaw': 0.5}
    estimator = StateEstimator(StateEstimatorParameters(standing_at_start=True, **start))
    rule, memory = InputRules(TimingParameters()).forces, None
    for stamp_ns, measured in messages['/a1_0/measured'].items():
        wanted = rule.wanted(stamp_ns)
        plan = None if wanted is None else messages['/a1_0/ground_forces'][wanted]
        estimate = estimator.step(memory, measured, plan)
        memory, told = estimate.memory, messages['/a1_0/state'][stamp_ns]
        np.testing.assert_array_equal(estimate.state.configuration, told.configuration)
        np.testing.assert_array_equal(estimate.state.velocity, told.velocity)


def standing(stamp_ns: int, load: float = 40.0) -> Measured:
    joints = np.zeros((3, 12))
    joints[0] = np.tile([0.0, 0.85, -1.7], 4)
    level, gravity = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, GRAVITY])
    return Measured(stamp_ns, joints, level, np.zeros(3), gravity, np.full(4, load))


class Sensors:
    """Sends what the sensors of a robot at rest read, a millisecond later each time."""

    def __init__(self, live: LiveNode) -> None:
        self.publisher = live.node.create_publisher(JointState, '/a1_0/measured', 50)
        self.pose = live.node.create_publisher(PoseStamped, '/a1_0/external_pose', 10)
        self._writer = MeasuredWriter('a1_0')
        self.stamp_ns, self.load = time.monotonic_ns() // MS * MS, 2.0

    def send(self) -> None:
        """Send what is due, but for what is too old by now."""
        now_ns = time.monotonic_ns()
        self.stamp_ns = max(self.stamp_ns, (now_ns // MS - 20) * MS)
        while self.stamp_ns + MS < now_ns:
            self.stamp_ns += MS
            self.publisher.publish(self._writer.encode(standing(self.stamp_ns, self.load)))

    def send_broken(self) -> None:
        self.stamp_ns += MS
        self.publisher.publish(self._writer.encode(standing(self.stamp_ns, math.nan)))

    def send_pose(self, frame: str, x: float) -> None:
        pose = PoseStamped(header=header(self.stamp_ns, frame))
        pose.pose.position.x, pose.pose.orientation.w = x, 1.0
        self.pose.publish(pose)


def test_a_robot_is_told_of_once_it_stands_and_nothing_bad_moves_it():
    start = ('-p', 'start_x:=2.0', '-p', 'start_y:=1.0')
    live = LiveNode('state_estimator', '-r', '__ns:=/a1_0', '-p', 'time:=real_time', *start)
    try:
        states: list[JointState] = []
        odometry: list[Odometry] = []
        live.node.create_subscription(JointState, '/a1_0/state', states.append, 50)
        live.node.create_subscription(Odometry, '/a1_0/odom', odometry.append, 10)
        sensors = Sensors(live)
        live.until_matched(sensors.publisher, sensors.pose)
        live.until(lambda: 'a load on FL' in live.figures.get('waits_for', ''), sensors.send)
        assert not states
        sensors.load = 40.0
        live.until(lambda: len(states) > 20 and len(odometry) > 2, sensors.send)

        wild = itertools.cycle((9.0, -9.0))  # what agrees with itself is believed in the end
        refusals = (
            (sensors.send_broken, 'finite'),
            (lambda: sensors.send_pose('camera', 2.0), "in frame 'camera'"),
            (lambda: sensors.send_pose('world', math.nan), 'finite'),
            (lambda: sensors.send_pose('world', next(wild)), 'off'),
        )
        for spoil, words in refusals:

            def act(spoil=spoil) -> None:
                sensors.send()
                spoil()

            live.until(lambda words=words: words in live.figures.get('last_rejected', ''), act)
        live.until(lambda: len(states) > 200, sensors.send)
        place = odometry[-1].pose.pose.position
        assert (place.x, place.y) == pytest.approx((2.0, 1.0), abs=0.02)  # the CoM is there
        assert place.z == pytest.approx(0.02 + 0.4 * math.cos(0.85), abs=2e-3)
        spread = np.array(odometry[-1].pose.covariance).reshape(6, 6)
        assert (np.diag(spread) > 0.0).all()
        assert np.isfinite([*states[-1].position, *states[-1].velocity]).all()
    finally:
        code = live.stop()
    assert code == 0


def test_in_lockstep_it_must_stand_from_the_first_tick_on():
    """Everybody would wait for its first state for ever: that is said at once."""
    program = 'from layered_cbf_ros.nodes.state_estimator import main; main()'
    command = [sys.executable, '-c', program, '--ros-args', '-r', '__ns:=/a1_0']
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert 'standing_at_start' in done.stderr
