"""The driver as a process, and at the other end of real UDP a robot that notes what it is told."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest
from live_driver import CARRYING, PACE, LiveDriver
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from layered_cbf_ros.interfaces import JOINT_NAMES, NS_PER_S
from layered_cbf_ros.messages import standard
from layered_cbf_ros.messages.measured import MeasuredReader
from layered_cbf_ros.plants.a1.poses import standing_pose
from layered_cbf_ros.scenario_emulation import BUTTONS

pytestmark = pytest.mark.system


@pytest.fixture
def driver(request):
    live = LiveDriver(*getattr(request, 'param', ()))
    yield live
    live.close()


def assert_damped_then_off(frames) -> None:
    """Check how a robot was let go: 1 to 2 s of damping, then motors off, then nothing."""
    off = next(k for k, frame in enumerate(frames) if frame.is_off)
    first = off
    while first and frames[first - 1].damps:
        first -= 1
    assert 0.9 <= PACE * (frames[off].at - frames[first].at) <= 2.0
    assert len(frames) - off >= 5
    assert all(frame.is_off for frame in frames[off:])


def test_a_robot_is_armed_stood_up_driven_stopped_and_let_go(driver):
    """One robot's day: silent, armed, standing, running, e-stop, reset, sat down."""
    robot = driver.robot
    driver.until_state('disarmed')
    assert not driver.call('sit_down').success
    assert robot.frames == []

    robot.silent = True
    assert driver.call('arm').success
    driver.until_state('disarmed: no answer from 127.0.0.1')
    seen = len(robot.frames)
    assert seen > 100
    assert all(frame.damps for frame in robot.frames)
    robot.silent = False
    assert 'disarmed' in driver.call('sit_down').message
    assert len(robot.frames) == seen

    assert driver.call('arm').success
    driver.until_state('standing')
    driver.until_state('running', driver.control)
    carried = tuple(CARRYING)
    driver.until(lambda: robot.frames[-1].torque == carried, driver.control)
    assert not any((*robot.frames[-1].kp, *robot.frames[-1].kd))
    driver.until(lambda: {'joint_states', 'remote'} <= set(driver.heard), driver.control)
    assert np.allclose(driver.heard['joint_states'].position, standing_pose(0.26), atol=1e-4)
    assert len(driver.heard['remote'].buttons) == len(BUTTONS)
    intervals = np.diff(driver.stamps)
    assert not (intervals % 1_000_000).any()
    assert (intervals > 0).all()
    assert MeasuredReader().read(driver.measured).specific_force[2] == pytest.approx(9.81)

    driver.until(
        lambda: driver.states[-1] == 'fault: emergency stop',
        lambda: driver.e_stop.publish(Bool(data=True)),
    )
    driver.until(lambda: robot.frames[-1].damps)
    driver.until_matched(driver.commands)
    assert 'emergency stop' in driver.call('arm').message
    assert driver.call('reset').success
    driver.until_state('disarmed')
    assert_damped_then_off(robot.frames)

    robot.frames.clear()
    assert driver.call('arm').success
    driver.until_state('standing')
    robot.press('L2', 'B')
    driver.until_state('fault: L2 + B pressed on the remote control')
    assert driver.end(signal.SIGINT) == 0
    assert_damped_then_off(robot.frames)


def test_controllers_that_die_or_talk_nonsense_are_damped(driver):
    driver.call('arm')
    driver.until_state('running', driver.control)
    driver.until_state('fault: no joint command for')  # nobody commands any more
    driver.until(lambda: driver.robot.frames[-1].damps)
    assert driver.call('reset').success
    driver.until_state('disarmed')
    assert driver.call('arm').success
    driver.until_state('standing')
    assert driver.call('sit_down').success
    driver.until_state('sitting_down')
    short = standard.named_values(driver.stamps[-1], JOINT_NAMES)
    short.effort = short.effort[:3]
    driver.commands.publish(short)
    driver.until_state('fault: joint command refused: joint state has 12 names but 3 of effort')
    driver.until(lambda: driver.robot.frames[-1].damps)


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
def test_whatever_ends_the_driver_the_robot_is_damped_and_then_off(driver, number):
    driver.call('arm')
    driver.until_state('standing')
    assert driver.end(number) == 0
    assert_damped_then_off(driver.robot.frames)


def test_a_driver_that_is_killed_falls_silent_in_the_middle_of_its_work(driver):
    """Nobody damps then but the robot itself, by its own time-out."""
    driver.call('arm')
    driver.until_state('standing')
    assert driver.end(signal.SIGKILL) == -signal.SIGKILL
    seen = len(driver.robot.frames)
    assert min(driver.robot.frames[-1].kp) > 0.0
    time.sleep(0.2)
    assert len(driver.robot.frames) == seen


@pytest.mark.parametrize('driver', [('--listen-only',)], indirect=True)
def test_who_only_listens_tells_what_is_heard_and_sends_nothing(driver):
    driver.until_state('disarmed')
    driver.robot.answer_unasked(driver.port)
    driver.until(lambda: 'joint_states' in driver.heard and len(driver.stamps) > 50)
    assert 'only listens' in driver.call('arm').message
    assert driver.robot.frames == []


@pytest.mark.parametrize('driver', [('--dry-run',)], indirect=True)
def test_a_dry_run_tells_what_it_would_send_and_sends_nothing(driver):
    would = []
    driver.node.create_subscription(JointState, '/a1_0/a1_driver/would_send', would.append, 10)
    driver.robot.answer_unasked(driver.port)
    assert driver.call('arm').success
    driver.until_state('standing')
    pose = standing_pose(0.26)
    driver.until(lambda: bool(would) and np.allclose(would[-1].position[:12], pose))
    assert would[-1].position[12] == 100.0  # kp of a held pose
    assert driver.robot.frames == []
    assert would[-1].header.stamp.sec * NS_PER_S <= driver.stamps[-1] + NS_PER_S


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'address': '192.168.123.10', 'arm_at_start': 'true'}, 'is not this computer'),
        ({'tilt': 120.0}, 'DriverParameters.tilt'),
        ({'robot_port': 1}, "unknown parameter 'robot_port'"),
    ],
)
def test_bad_parameters_are_one_line_and_exit_code_2(parameters, words):
    live = LiveDriver(**parameters)
    assert live.process.wait(20.0) == 2
    told = live.process.stderr.read().strip()
    assert '\n' not in told
    assert told.startswith('ERROR')
    assert words in told
    live.close()
