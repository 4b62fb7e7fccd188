"""Each node, as a real process, refuses what is bad, says so, and goes on safely."""

import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseArray
from live_node import ENVIRONMENT, LiveNode
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from layered_cbf_ros.interfaces import JOINT_NAMES, NS_PER_S, PlannedMotion, RobotState, Track
from layered_cbf_ros.messages.joint_state import JointStateWriter
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.messages.standard import named_values, points, track_odometry
from layered_cbf_ros.messages.trajectory import TrajectoryWriter
from layered_cbf_ros.node_parameters import parameter_names
from layered_cbf_ros.robot_model import RobotModel

pytestmark = pytest.mark.system

MS = 1_000_000
COV = np.diag([1e-4, 1e-4, 1e-3, 1e-3])
REAL_TIME = ('-p', 'time:=real_time')
WEIGHT_TORQUE = 1.0  # a standing robot's joints carry more than this [Nm]


def standing_state(stamp_ns: int) -> RobotState:
    configuration = RobotModel().nominal_configuration(np.zeros(2), 0.0)
    return RobotState(stamp_ns, configuration, np.zeros(18), np.zeros(12), np.full(4, 30.0))


class StateSender:
    """Sends the state of a robot that stands, a millisecond later each time."""

    def __init__(self, live: LiveNode) -> None:
        self.publisher = live.node.create_publisher(JointState, '/state', 10)
        self._writer = StateWriter(['a1_0'])
        self.stamp_ns = NS_PER_S

    def send(self) -> None:
        self.stamp_ns += 2 * MS
        self.publisher.publish(self._writer.encode([standing_state(self.stamp_ns)]))


@pytest.fixture(params=['whole_body_controller', 'ground_force_mpc'])
def controller(request):
    live = LiveNode(request.param, '-r', '__ns:=/a1_0', *REAL_TIME)
    yield live, request.param
    assert live.stop() == 0


def listen(live: LiveNode, name: str) -> list[JointState]:
    topic = {'whole_body_controller': 'joint_commands', 'ground_force_mpc': 'ground_forces'}
    heard: list[JointState] = []
    live.node.create_subscription(JointState, f'/a1_0/{topic[name]}', heard.append, 10)
    return heard


def test_controllers_refuse_bad_states_and_go_on(controller):
    live, name = controller
    heard, states = listen(live, name), StateSender(live)
    live.until_matched(states.publisher)
    live.until(lambda: len(heard) > 5, states.send)
    nan = np.full(18, math.nan)
    for spoil in (
        lambda state: StateWriter(['a1_0']).encode([dataclasses.replace(state, velocity=nan)]),
        lambda state: StateWriter(['a1_7']).encode([state]),
        lambda state: StateWriter(['a1_0']).encode([state])[:200],
        lambda state: b'\x00\x01\x00\x00',
    ):
        before = int(live.figures.get('rejected', 0))

        def act(spoil=spoil) -> None:
            states.stamp_ns += 2 * MS
            states.publisher.publish(spoil(standing_state(states.stamp_ns)))

        live.until(lambda before=before: int(live.figures.get('rejected', 0)) > before, act)
    assert live.figures['last_rejected']
    count = len(heard)
    live.until(lambda: len(heard) > count + 5, states.send)
    efforts = np.array([message.effort for message in heard])
    assert np.isfinite(efforts).all()
    assert np.abs(efforts[-1]).max() > WEIGHT_TORQUE


def test_one_state_of_another_clock_does_not_silence_a_controller(controller):
    live, name = controller
    heard, states = listen(live, name), StateSender(live)
    live.until_matched(states.publisher)
    live.until(lambda: len(heard) > 5, states.send)
    strange = standing_state(states.stamp_ns + 3600 * NS_PER_S)
    states.publisher.publish(StateWriter(['a1_0']).encode([strange]))
    count = len(heard)
    live.until(lambda: len(heard) > count + 20, states.send)


def test_controllers_stand_when_the_plan_is_not_a_number(controller):
    """A bad plan is no plan: the robot brakes and stands, and its forces carry it."""
    live, name = controller
    heard, states = listen(live, name), StateSender(live)
    plan = live.node.create_publisher(MultiDOFJointTrajectory, '/safe_trajectory', 10)
    live.until_matched(states.publisher, plan)
    writer = TrajectoryWriter(['a1_0'])
    nan = PlannedMotion(0, np.array([math.nan, 0.0]), np.zeros(2), np.zeros(2), 0.0, 0.0)

    def act() -> None:
        plan.publish(writer.encode(states.stamp_ns, [nan]))
        states.send()

    live.until(lambda: int(live.figures.get('rejected', 0)) > 0, act)
    live.until(lambda: len(heard) > 5, act)
    assert 'finite' in live.figures['last_rejected']
    assert np.isfinite(heard[-1].effort).all()


def test_coordinator_does_not_know_a_broken_track(tmp_path):
    live = LiveNode('coordinator', '-p', 'scenario:=one_agent_three_obstacles', *REAL_TIME)
    plans: list[MultiDOFJointTrajectory] = []
    live.node.create_subscription(MultiDOFJointTrajectory, '/safe_trajectory', plans.append, 10)
    tracks = live.node.create_publisher(Odometry, '/obstacles/tracks', 10)
    states = StateSender(live)
    live.until_matched(states.publisher, tracks)
    bad = Odometry(child_frame_id='ghost')
    bad.twist.twist.linear.x = math.nan

    def act() -> None:
        tracks.publish(bad)
        states.send()

    live.until(lambda: int(live.figures.get('rejected', 0)) > 0 and len(plans) > 5, act)
    assert "'ghost'" in live.figures['last_rejected']
    for plan in plans:
        twist = plan.points[0].velocities[0].linear
        assert math.isfinite(twist.x)
        assert math.isfinite(twist.y)
    assert live.stop() == 0


def test_an_obstacle_is_not_forgotten_when_its_tracker_falls_silent():
    """Its barrier stays, and its reachable set grows: the barrier falls with its age."""
    live = LiveNode('coordinator', '-p', 'scenario:=one_agent_three_obstacles', *REAL_TIME)
    told: list[JointTrajectory] = []
    live.node.create_subscription(JointTrajectory, '/coordinator/barriers', told.append, 10)
    tracks = live.node.create_publisher(Odometry, '/obstacles/tracks', 10)
    states = StateSender(live)
    live.until_matched(states.publisher, tracks)
    track = Track('cart', states.stamp_ns, np.array([3.0, 0.0]), np.array([0.3, 0.0]), COV, 0.3)
    pair = 'a1_0~cart'

    def psi0() -> float:
        message = told[-1]
        return message.points[-1].positions[message.joint_names.index(pair)]

    def act() -> None:
        tracks.publish(track_odometry(dataclasses.replace(track, stamp_ns=states.stamp_ns)))
        states.send()

    live.until(lambda: bool(told) and pair in told[-1].joint_names, act)
    seen_at, fresh = states.stamp_ns, psi0()
    live.until(lambda: states.stamp_ns > seen_at + 3 * NS_PER_S, states.send)
    assert pair in told[-1].joint_names
    assert psi0() < fresh - 0.2
    assert live.stop() == 0


def test_simulator_damps_a_robot_whose_commands_are_bad():
    """Neither NaN nor unknown joints nor silence moves a motor; time goes on."""
    live = LiveNode('simulator', '-p', 'scenario:=stand', *REAL_TIME)
    heard: list[JointState] = []
    live.node.create_subscription(JointState, '/state', heard.append, 10)
    commands = live.node.create_publisher(JointState, '/a1_0/joint_commands', 10)
    live.until_matched(commands)

    def stamp() -> int:
        header = heard[-1].header.stamp
        return header.sec * NS_PER_S + header.nanosec

    def act() -> None:
        if heard:
            effort = np.full(12, math.nan)
            data = JointStateWriter(JOINT_NAMES).encode(stamp(), *np.zeros((2, 12)), effort)
            commands.publish(data)
            commands.publish(named_values(stamp(), ['elbow'], effort=np.array([30.0])))

    live.until(lambda: int(live.figures.get('rejected', 0)) > 1 and len(heard) > 50, act)
    assert np.isfinite(heard[-1].position).all()
    torques, speeds = np.array(heard[-1].effort)[7:19], np.array(heard[-1].velocity)[7:19]
    assert np.abs(torques).max() < 10.0
    assert torques @ speeds <= 0.0
    assert live.stop() == 0


def test_tracker_refuses_detections_that_are_not_numbers():
    live = LiveNode('obstacle_tracker', *REAL_TIME)
    tracks: list[Odometry] = []
    live.node.create_subscription(Odometry, '/obstacles/tracks', tracks.append, 10)
    detections = live.node.create_publisher(PoseArray, '/obstacles/detections', 10)
    live.until_matched(detections)
    stamp_ns = [NS_PER_S]

    def act() -> None:
        stamp_ns[0] += 10 * MS
        detections.publish(points(stamp_ns[0], np.array([[1.0, 2.0], [math.nan, 0.0]])))

    detections.publish(b'\x00\x01\x00\x00\x01')  # cut short: no reason to die
    live.until(lambda: int(live.figures.get('rejected', 0)) > 0 and len(tracks) > 5, act)
    at = tracks[-1].pose.pose.position
    assert (at.x, at.y) == pytest.approx((1.0, 2.0), abs=0.01)
    assert live.stop() == 0


@pytest.mark.parametrize(
    ('executable', 'arguments', 'words'),
    [
        ('coordinator', ['-p', 'scenario:=no_such_world'], 'no_such_world'),
        ('coordinator', ['-p', 'scenario:=stand', '-p', 'alpha1:=-1.0'], 'alpha1'),
        ('simulator', ['-p', 'scenario:=stand', '-p', 'time:=warp'], 'time'),
        ('recorder', ['-p', 'storage_preset:=best'], 'storage_preset'),
        ('whole_body_controller', ['-p', 'frictoin:=0.5'], 'frictoin'),
    ],
)
def test_a_wrong_parameter_is_one_clear_line(executable, arguments, words):
    live = LiveNode(executable, *arguments)
    try:
        assert live.process.wait(30.0) == 2
        lines = live.process.stderr.read().strip().splitlines()
        lines = [line for line in lines if not line.startswith('pybullet build time')]
        assert len(lines) == 1
        assert words in lines[0]
    finally:
        if live.process.poll() is None:
            live.stop()


@pytest.mark.parametrize('executable', ['coordinator', 'simulator', 'ground_force_mpc'])
def test_help_lists_every_parameter_with_its_unit(executable):
    program = f'from layered_cbf_ros.nodes.{executable} import main; main()'
    command = [sys.executable, '-c', program, '--help']
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    for name in parameter_names(executable):
        assert f'  {name}: ' in done.stdout
    assert 'state_rate: states and joint commands [Hz] = 1000' in done.stdout
