"""A real coordinator process is steered, refused, stopped and reset over real topics."""

import math
import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import TwistStamped
from live_node import ENVIRONMENT, LiveNode
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from layered_cbf_ros.interfaces import NS_PER_S, RobotState
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.operation.virtual_pad import PadState
from layered_cbf_ros.robot_model import RobotModel

pytestmark = pytest.mark.system

ROBOTS = ('alpha', 'beta')
WORLD = """\
description: Two robots that want nothing, far apart.
duration: 60.0
robots:
  - {name: alpha, position: [0.0, 0.0]}
  - {name: beta, position: [5.0, 0.0], yaw: 1.5708}
"""
PUBLISHER = textwrap.dedent("""\
    import rclpy, time
    from sensor_msgs.msg import Joy
    rclpy.init()
    node = rclpy.create_node('somebody')
    joy = Joy(axes=[0.0, 1.0, 0.0, 0.0], buttons=[0, 0, 0, 0, 1, 0, 0, 0])
    publisher = node.create_publisher(Joy, '/joy', 10)
    while True:
        publisher.publish(joy)
        time.sleep(0.05)
    """)


class Team:
    """A coordinator, and robots that are always just where it wants them."""

    def __init__(self, tmp_path):
        world = tmp_path / 'world.yaml'
        world.write_text(WORLD)
        self.live = LiveNode('coordinator', '-p', f'scenario:={world}', '-p', 'time:=real_time')
        node = self.live.node
        self._model, self._writer = RobotModel(), StateWriter(list(ROBOTS))
        self._states = node.create_publisher(JointState, '/state', 10)
        self.joy = node.create_publisher(Joy, '/joy', 10)
        self.stop = node.create_publisher(Bool, '/e_stop', 10)
        self.cmd_vel = node.create_publisher(TwistStamped, '/beta/cmd_vel', 10)
        self.reset = node.create_client(Trigger, '/coordinator/reset_e_stop')
        self.places = {'alpha': (0.0, 0.0, 0.0), 'beta': (5.0, 0.0, 1.5708)}
        self.velocities = dict.fromkeys(ROBOTS, (0.0, 0.0))
        self.heights = dict.fromkeys(ROBOTS, 0.0)
        self.commands = []
        node.create_subscription(MultiDOFJointTrajectory, '/safe_trajectory', self._follow, 10)
        node.create_subscription(JointTrajectory, '/coordinator/commands', self.commands.append, 10)
        self._stamp_ns = NS_PER_S
        self.live.until_matched(self._states, self.joy, self.stop, self.cmd_vel)

    def tick(self):
        """Send the state of both robots."""
        self._stamp_ns += 7_000_000  # no multiple of any period
        states = []
        for name in ROBOTS:
            x, y, yaw = self.places[name]
            configuration = self._model.nominal_configuration(np.array([x, y]), yaw)
            configuration[2] += self.heights[name]
            still = np.zeros(18), np.zeros(12), np.full(4, 30.0)
            states.append(RobotState(self._stamp_ns, configuration, *still))
        self._states.publish(self._writer.encode(states))

    def _follow(self, message):
        for name, transform, velocity in zip(
            message.joint_names,
            message.points[0].transforms,
            message.points[0].velocities,
            strict=True,
        ):
            place, turn = transform.translation, transform.rotation
            yaw = 2.0 * math.atan2(turn.z, turn.w)
            self.places[name] = (place.x, place.y, yaw)
            self.velocities[name] = velocity.linear.x, velocity.linear.y
            self.heights[name] = place.z

    def hold(self, pad, stamp=None):
        """Return what to do every moment: a tick, and a message of the virtual pad."""
        message = Joy(axes=pad.axes(), buttons=pad.buttons(2))
        message.header.frame_id = 'virtual_pad/test'
        if stamp is not None:
            message.header.stamp.sec = stamp

        def act():
            self.tick()
            self.joy.publish(message)

        return act

    def is_still(self):
        return all(math.hypot(*velocity) < 1e-3 for velocity in self.velocities.values())


@pytest.fixture
def team(tmp_path):
    made = Team(tmp_path)
    yield made
    assert made.live.stop() == 0


def test_joy_of_another_process_moves_one_robot_and_its_death_stops_it(team):
    """The default layout: stick forward and the enable button, stamp 0, as a terminal sends it."""
    process = subprocess.Popen([sys.executable, '-c', PUBLISHER], env=ENVIRONMENT)
    try:
        team.live.until(lambda: team.velocities['alpha'][0] > 0.3, team.tick)
        assert team.velocities['beta'] == (0.0, 0.0)
        os.kill(process.pid, signal.SIGKILL)
        team.live.until(team.is_still, team.tick)
    finally:
        process.kill()
        process.wait()
    assert team.places['alpha'][0] > 0.1
    last = team.commands[-1]
    told = dict(zip(last.joint_names, last.points[-1].velocities, strict=True))
    given = dict(zip(last.joint_names, last.points[-1].effort, strict=True))
    assert (told['alpha/x'], given['alpha/x'], given['beta/x']) == (0.0, 1.0, 0.0)


def test_a_chosen_robot_goes_by_its_own_heading_and_a_formation_by_the_first_ones(team):
    """beta looks along +y; alpha, the first, along +x."""
    team.live.until(
        lambda: team.velocities['beta'][1] > 0.2, team.hold(PadState(x=1.0, enable=True, robot=1))
    )
    assert abs(team.velocities['beta'][0]) < 0.01
    assert team.velocities['alpha'] == (0.0, 0.0)
    team.live.until(
        lambda: min(v[0] for v in team.velocities.values()) > 0.2,
        team.hold(PadState(x=1.0, enable=True, formation=True)),
    )
    team.live.until(team.is_still, team.hold(PadState(x=1.0)))


def test_bad_joy_messages_are_refused_counted_and_named(team):
    def refused(message, words):
        before = int(team.live.figures.get('rejected', '0'))

        def act():
            team.tick()
            team.joy.publish(message)

        team.live.until(lambda: int(team.live.figures.get('rejected', '0')) > before, act)
        team.live.until(lambda: words in team.live.figures['last_rejected'], act)

    refused(Joy(axes=[0.0], buttons=[0] * 8), 'has 1 axes')
    refused(Joy(axes=[math.nan] * 4, buttons=[0] * 8), 'axes[0] is nan')
    old = Joy(axes=[0.0, 1.0, 0.0, 0.0], buttons=[0, 0, 0, 0, 1, 0, 0, 0])
    old.header.stamp.sec = 1_500_000_000
    refused(old, 'is stamped')
    assert team.velocities == dict.fromkeys(ROBOTS, (0.0, 0.0))


def test_a_planner_is_heard_clamped_and_refused(team):
    def send(x, frame_id='', y=0.0):
        message = TwistStamped()
        message.header.frame_id = frame_id
        message.twist.linear.x, message.twist.linear.y = x, y

        def act():
            team.tick()
            team.cmd_vel.publish(message)

        return act

    team.live.until(lambda: team.velocities['beta'][1] > 0.45, send(3.0))
    assert team.velocities['beta'][1] < 0.5 + 1e-6
    team.live.until(lambda: 'asks for 3.00 m/s' in team.live.figures['last_clamped'], send(3.0))
    team.live.until(team.is_still, team.tick)
    team.live.until(lambda: 'not finite' in team.live.figures['last_rejected'], send(math.nan))
    team.live.until(lambda: "'map'" in team.live.figures['last_rejected'], send(0.1, 'map'))
    assert team.is_still()


def test_the_emergency_stop_is_latched_sits_everybody_down_and_is_reset_on_purpose(team):
    walk = team.hold(PadState(x=1.0, enable=True, robot=0))
    team.live.until(lambda: team.velocities['alpha'][0] > 0.2, walk)

    def press():
        walk()
        team.stop.publish(Bool(data=True))

    team.live.until(lambda: all(z < -0.16 for z in team.heights.values()), press)
    assert team.is_still()

    def release():
        walk()
        team.stop.publish(Bool(data=False))

    team.live.until(lambda: team.live.figures['e_stop'] == 'latched', release)
    place = team.places['alpha'][:2]
    team.live.until(team.reset.service_is_ready, release)
    assert team.heights['alpha'] < -0.16
    assert team.places['alpha'][:2] == pytest.approx(place, abs=0.01)
    done = team.reset.call_async(Trigger.Request())
    team.live.until(done.done, team.tick)
    assert done.result().success
    team.live.until(lambda: all(z > -1e-6 for z in team.heights.values()), team.tick)
    team.live.until(lambda: team.velocities['alpha'][0] > 0.2, walk)
