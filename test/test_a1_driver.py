"""The driver's mind: what it lets an A1 do, and how it lets go."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.parameters import from_mapping
from layered_cbf_ros.plants.a1.driver_memory import (
    Heard,
    JointCommand,
    Memory,
    Order,
)
from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.a1.driving import Driving
from layered_cbf_ros.plants.a1.frames import MOTOR_OFF, OVERHEATED, SERVO, LowState
from layered_cbf_ros.plants.a1.orders import obey
from layered_cbf_ros.plants.a1.poses import standing_pose
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Robot, Scenario, World

MS = 1_000_000
PARAMETERS = DriverParameters()
STANDING = standing_pose(PARAMETERS.com_height)
LYING = np.tile([0.05, 1.11, -2.697], 4)
# A quarter of an A1's 12.46 kg on each toe straight below its hip: only the knee carries,
# with the lower leg's horizontal reach as lever (0.2 m sin 0.863).
CARRYING = np.tile([0.0, 0.0, 12.458 * 9.81 / 4 * 0.2 * math.sin(0.8626)], 4)
SAGGED = STANDING - CARRYING / PARAMETERS.stand_kp
EVERY_DRIVEN_PHASE = ('standing_up', 'standing', 'running', 'sitting_down')


def told(**changes) -> LowState:
    """Return what a robot tells that stands still and is well, but for the changes."""
    state = LowState(
        tick=0,
        mode=np.full(12, SERVO),
        position=SAGGED,
        velocity=np.zeros(12),
        torque=CARRYING,
        temperature=np.full(12, 30),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
        angular_velocity=np.zeros(3),
        specific_force=np.array([0.0, 0.0, 9.81]),
        foot_force=np.full(4, 30.0),
        remote=bytes(40),
    )
    return replace(state, **changes)


class Bench:
    """Drives a robot that tells what it is made to tell, cycle by cycle of 1 ms.

    Attributes:
        state: What it tells from now on, None: it is silent.
        torque: What a controller commands from now on [Nm], None: it is silent.
        sent: The last frame, None if none was sent.
    """

    def __init__(self, parameters: DriverParameters = PARAMETERS) -> None:
        self.parameters = parameters
        self.driving = Driving(parameters, STANDING)
        self.memory = Memory()
        self.now_ns = 7 * NS_PER_S
        self.state: LowState | None = told()
        self.torque: np.ndarray | None = None
        self.sent = None
        self.heard = Heard(self.now_ns)

    @property
    def phase(self) -> str:
        return self.memory.phase.value

    def cycle(self, count: int = 1, **heard) -> None:
        """Go on by some cycles; the last of them also hears what is given."""
        for last in range(count - 1, -1, -1):
            self.now_ns += MS
            seen = {'now_ns': self.now_ns, 'is_new': self.state is not None}
            if self.state is not None:
                seen |= {'state': self.state, 'state_ns': self.now_ns}
            if self.torque is not None:
                none = np.zeros(12)
                seen['command'] = JointCommand(self.now_ns, none, none, self.torque)
            seen |= {'bad_command': '', 'emergency_stop': False, 'buttons': frozenset()}
            self.heard = replace(self.heard, **(seen | (heard if not last else {})))
            self.memory, self.sent = self.driving.step(self.memory, self.heard)

    def order(self, order: Order):
        self.memory, answer = obey(self.driving, self.parameters, self.memory, order, self.heard)
        return answer

    def until(self, phase: str, cycles: int = 6000) -> list:
        """Cycle until a phase begins; return all frames sent on the way."""
        frames = []
        while self.phase != phase:
            assert len(frames) < cycles, f'{self.phase}, never {phase}: {self.memory.trouble}'
            self.cycle()
            frames.append(self.sent)
        return frames

    def joint_torque(self) -> np.ndarray:
        """Return what the motors do with the last frame, by their joint law [Nm]."""
        sent, state = self.sent, self.state
        return (
            sent.torque
            + sent.kp * (sent.position - state.position)
            + sent.kd * (sent.velocity - state.velocity)
        )


def brought_to(phase: str, parameters: DriverParameters = PARAMETERS) -> Bench:
    """Return a bench whose robot is in a phase."""
    bench = Bench(parameters)
    assert bench.order(Order.ARM).success
    if phase == 'engaging':
        return bench
    bench.state = told(position=LYING) if phase == 'standing_up' else told()
    bench.until('standing_up')
    if phase == 'standing_up':
        return bench
    bench.until('standing')
    if phase == 'standing':
        return bench
    bench.torque = CARRYING
    bench.until('running')
    if phase == 'running':
        bench.cycle(500)
        return bench
    assert bench.order(Order.SIT_DOWN).success
    bench.cycle()
    return bench


def is_damping(sent) -> bool:
    """Tell whether a frame can only take energy out of the joints: tau = -kd q'."""
    nothing = (sent.kp, sent.torque, sent.velocity)
    return sent.mode == SERVO and not any(map(np.any, nothing)) and bool((sent.kd >= 1.0).all())


def tilted(degrees: float, about: float, yaw: float) -> np.ndarray:
    """Return the orientation of a trunk tilted about a horizontal axis, turned by a yaw."""
    half, turn = math.radians(degrees) / 2, yaw / 2
    axis = np.array([math.cos(about), math.sin(about), 0.0]) * math.sin(half)
    x, y = axis[:2]
    w, c, s = math.cos(half), math.cos(turn), math.sin(turn)
    return np.array([c * x - s * y, c * y + s * x, s * w, c * w])  # yaw after tilt


def one(value: float, joint: int, base: np.ndarray) -> np.ndarray:
    changed = np.array(base)
    changed[joint] = value
    return changed


PROTECTIONS = {
    'tilt': (told(orientation=tilted(61.0, 2.1, 0.7)), 'tilt of 61 deg'),
    'IMU': (told(orientation=np.zeros(4)), 'IMU orientation'),
    'hip limit': (told(position=one(0.73, 3, SAGGED)), 'FR_hip_joint at 0.730 rad'),
    'calf limit': (told(position=one(-2.65, 8, SAGGED)), 'RL_lower_joint at -2.650 rad'),
    'torque': (told(torque=one(-36.0, 11, CARRYING)), 'RR_lower_joint at 36.0 Nm'),
    'speed': (told(velocity=one(-21.5, 1, np.zeros(12))), 'FL_upper_joint at 21.5 rad/s'),
    'power': (told(torque=np.full(12, 4.0), velocity=np.full(12, -8.5)), 'power of 408 W'),
    'temperature': (told(temperature=one(81, 5, np.full(12, 30))), 'FR_lower_joint has 81 degC'),
    'overheated': (
        told(mode=one(OVERHEATED, 2, np.full(12, SERVO))),
        'FL_lower_joint is in mode 8',
    ),
    'off': (told(mode=np.full(12, MOTOR_OFF)), 'is in mode 0'),
}


@pytest.mark.parametrize('name', PROTECTIONS)
def test_what_the_robot_tells_ends_its_drive(name):
    """Latched, with a damping frame at once; only overloads are let pass for five states."""
    bench = brought_to('running')
    bench.state, words = PROTECTIONS[name]
    bench.cycle(6 if name in ('torque', 'speed', 'power') else 1)
    assert bench.phase == 'fault'
    assert words in bench.memory.fault
    assert is_damping(bench.sent)
    bench.state = told()
    bench.cycle(3000)
    assert bench.phase == 'fault'
    assert is_damping(bench.sent)


@pytest.mark.parametrize('phase', EVERY_DRIVEN_PHASE)
@pytest.mark.parametrize(
    ('heard', 'words'),
    [
        ({'buttons': frozenset({'R2', 'X'})}, 'R2'),
        ({'buttons': frozenset({'L2', 'B'})}, 'L2 + B'),
        ({'emergency_stop': True}, 'emergency stop'),
        ({'bad_command': 'a value is not finite'}, 'not finite'),
    ],
)
def test_whoever_asks_for_a_stop_gets_it_in_the_same_cycle(phase, heard, words):
    bench = brought_to(phase)
    bench.cycle(**heard)
    assert bench.phase == 'fault'
    assert words in bench.memory.fault
    assert is_damping(bench.sent)


@pytest.mark.parametrize(
    'state',
    [
        told(orientation=tilted(59.0, 0.3, -2.0)),
        told(position=one(0.70, 3, SAGGED)),
        told(torque=one(34.0, 11, CARRYING)),
        told(velocity=one(20.5, 1, np.zeros(12))),
        told(torque=np.full(12, 4.0), velocity=np.full(12, 8.0)),
        told(temperature=np.full(12, 80)),
    ],
)
def test_what_is_just_allowed_ends_nothing(state):
    bench = brought_to('running')
    bench.state = state
    bench.cycle(100)
    assert bench.phase == 'running'


def test_power_counts_up_and_down_as_the_vendors_rule_does():
    """It trips when the count of states over 400 W, less those under, is more than 5."""
    rng = np.random.default_rng(4)
    for _ in range(5):
        bench, count, trips = brought_to('running'), 0, False
        while not trips:
            over = bool(rng.random() < 0.55)
            count = count + 1 if over else max(0, count - 1)
            trips = count > 5
            speed = np.full(12, 8.5 if over else 0.1)
            bench.state = told(torque=np.full(12, 4.0), velocity=speed)
            bench.cycle()
            assert (bench.phase == 'fault') is trips


@pytest.mark.parametrize('phase', EVERY_DRIVEN_PHASE)
def test_a_robot_that_falls_silent_is_damped_after_20_ms(phase):
    bench = brought_to(phase)
    bench.state = None
    bench.cycle(20)
    assert bench.phase == phase
    bench.cycle()
    assert bench.phase == 'fault'
    assert 'no state' in bench.memory.fault
    assert is_damping(bench.sent)


def test_a_controller_that_falls_silent_is_replaced_by_damping_after_20_ms():
    bench = brought_to('running')
    bench.torque = None
    bench.cycle(20)
    assert bench.phase == 'running'
    bench.cycle()
    assert bench.phase == 'fault'
    assert 'no joint command for 21 ms' in bench.memory.fault
    assert is_damping(bench.sent)


def test_disarmed_it_sends_nothing_whatever_it_hears():
    bench = Bench()
    bench.torque = CARRYING
    for state, _ in PROTECTIONS.values():
        bench.state = state
        bench.cycle(50, buttons=frozenset({'L2', 'B'}))
        assert bench.phase == 'disarmed'
        assert bench.sent is None
    assert not bench.order(Order.SIT_DOWN).success
    assert not bench.order(Order.RESET).success


def test_nobody_is_armed_after_an_emergency_stop_before_a_reset():
    bench = Bench()
    bench.cycle(emergency_stop=True)
    assert bench.sent is None
    answer = bench.order(Order.ARM)
    assert not answer.success
    assert 'emergency stop' in answer.message
    assert bench.order(Order.RESET).success
    assert bench.order(Order.ARM).success


def test_a_fault_has_to_be_reset_and_the_robot_lies_disarmed_then():
    bench = brought_to('running')
    bench.cycle(emergency_stop=True)
    for order in (Order.ARM, Order.SIT_DOWN):
        assert not bench.order(order).success
    assert bench.order(Order.RESET).success
    frames = bench.until('disarmed')
    damped = [is_damping(frame) for frame in frames if frame is not None]
    assert 1000 <= sum(damped) <= 2000  # 1 to 2 s
    assert all(damped[: sum(damped)]), 'damping comes first'
    assert all(frame.mode == MOTOR_OFF for frame in frames[sum(damped) : -1])
    assert not bench.memory.trouble


def test_a_robot_that_never_answers_is_given_up_after_3_s():
    """Until then it gets damping, which is harmless; afterwards nothing."""
    bench = Bench()
    bench.state = None
    bench.cycle()
    bench.order(Order.ARM)
    frames = bench.until('disarmed')
    assert len(frames) == 3000
    assert all(map(is_damping, frames[:-1]))
    assert 'no answer from 192.168.123.10:8007' in bench.memory.trouble
    bench.cycle()
    assert bench.sent is None
    assert bench.order(Order.ARM).success  # there is nothing to reset


def test_it_stands_up_only_after_so_many_good_states_in_a_row():
    bench = brought_to('engaging')
    bench.cycle(PARAMETERS.needed_states - 1)
    bench.state = told(mode=one(MOTOR_OFF, 6, np.full(12, SERVO)))
    bench.cycle()
    bench.state = told()
    bench.cycle(PARAMETERS.needed_states - 1)
    assert bench.phase == 'engaging'
    assert is_damping(bench.sent)
    bench.cycle()
    assert bench.phase == 'standing_up'


def test_motors_that_do_not_obey_are_named():
    bench = brought_to('engaging')
    bench.state = told(mode=one(OVERHEATED, 6, np.full(12, SERVO)))
    bench.until('disarmed')
    assert 'RL_hip_joint is in mode 8' in bench.memory.trouble


def test_the_way_up_is_smooth_from_where_the_robot_lies():
    """Desired velocities are the derivatives of desired angles; neither leaps."""
    bench = brought_to('standing_up')
    first, frames = bench.sent, bench.until('standing')
    angles = np.array([frame.position for frame in frames])
    speeds = np.array([frame.velocity for frame in frames])
    assert np.allclose(first.position, LYING)
    assert np.allclose(angles[-1], STANDING)
    slope = (angles[2:] - angles[:-2]) / 0.002
    assert np.allclose(slope, speeds[1:-1], atol=0.01)  # central differences, 1 ms
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.02  # 20 rad/s^2
    assert 2000 <= len(frames) <= 4000


def test_a_controller_takes_over_without_a_step():
    bench = brought_to('standing')
    bench.cycle()
    before = bench.joint_torque()
    bench.torque = 1.2 * CARRYING
    bench.cycle()
    assert bench.phase == 'running'
    for _ in range(400):
        after = bench.joint_torque()
        assert np.abs(after - before).max() < 0.2  # of 5 Nm, in 1 ms
        before = after
        bench.cycle()
    assert np.allclose(bench.sent.torque, bench.torque)
    assert not bench.sent.kp.any()
    assert not bench.sent.kd.any()


@pytest.mark.parametrize('torque', [np.zeros(12), -CARRYING, 0.3 * CARRYING])
def test_nobody_takes_over_who_would_let_the_robot_fall(torque):
    bench = brought_to('standing')
    bench.torque = torque
    bench.cycle(200)
    assert bench.phase == 'standing'
    assert np.allclose(bench.joint_torque(), CARRYING)


def test_an_old_command_takes_nothing_over():
    bench = brought_to('standing')
    none = np.zeros(12)
    old = JointCommand(bench.now_ns - 25 * MS, none, none, CARRYING)
    bench.cycle(command=old)
    assert bench.phase == 'standing'


def test_commanded_torques_are_cut_to_the_limit():
    bench = brought_to('running')
    bench.torque = np.linspace(-90.0, 90.0, 12)
    bench.cycle()
    assert np.allclose(bench.sent.torque, np.clip(bench.torque, -33.5, 33.5))


def test_gains_act_on_commanded_angles_only_if_they_are_asked_for():
    bench = brought_to('running', from_mapping(DriverParameters, {'kp': 20.0, 'kd': 1.0}))
    command = JointCommand(bench.now_ns + MS, SAGGED + 0.1, np.full(12, 0.5), CARRYING)
    bench.cycle(command=command)
    # tau_ff + 20 * 0.1 rad + 1.0 * 0.5 rad/s
    assert np.allclose(bench.joint_torque(), CARRYING + 2.5)


@pytest.mark.parametrize('phase', ['standing', 'running'])
def test_sitting_down_begins_without_a_step_and_ends_disarmed(phase):
    bench = brought_to(phase)
    bench.cycle()
    before = bench.joint_torque()
    assert bench.order(Order.SIT_DOWN).success
    bench.torque = None  # the controller is not needed any more
    bench.cycle()
    assert np.abs(bench.joint_torque() - before).max() < 0.3
    frames = bench.until('disarmed')
    held = [frame for frame in frames if frame is not None and frame.kp.any()]
    assert np.allclose(held[-1].position, bench.driving.folded, atol=1e-4)
    assert not held[-1].torque.any()
    assert frames[-2].mode == MOTOR_OFF
    assert frames[-1] is None


@pytest.mark.parametrize('phase', ['engaging', *EVERY_DRIVEN_PHASE, 'fault'])
def test_the_end_of_the_process_damps_and_then_switches_off(phase):
    bench = brought_to('running' if phase == 'fault' else phase)
    bench.cycle(emergency_stop=phase == 'fault')
    bench.order(Order.END)
    bench.state = bench.torque = None
    frames = bench.until('disarmed')
    damped = sum(map(is_damping, frames[:-1]))
    assert 1000 <= damped <= 2000
    assert all(frame.mode == MOTOR_OFF for frame in frames[damped:-1])
    assert len(frames) - damped > 10


def test_a_dry_run_believes_motors_that_nobody_commands():
    bench = brought_to('engaging', from_mapping(DriverParameters, {'dry_run': True}))
    bench.state = told(mode=np.full(12, MOTOR_OFF))
    bench.until('standing')


def test_only_a_robot_on_this_computer_is_armed_unasked():
    for address in ('127.0.0.1', '127.0.0.9'):
        from_mapping(DriverParameters, {'address': address, 'arm_at_start': True})
    with pytest.raises(ParameterError, match=r'192\.168\.123\.10 is not this computer'):
        from_mapping(DriverParameters, {'arm_at_start': True})
    with pytest.raises(ParameterError, match="address is 'robot'; give an IPv4 address"):
        from_mapping(DriverParameters, {'address': 'robot'})
    refused = Bench(from_mapping(DriverParameters, {'listen_only': True})).order(Order.ARM)
    assert not refused.success
    assert 'only listens' in refused.message


def test_a_robot_that_lies_on_its_belly_stands_up_and_sits_down_again():
    """Physics: it ends at the height the layers expect, level, far from its torque limits."""
    model = RobotModel()
    lying = model.nominal_configuration(np.zeros(2), 0.0)
    height = lying[2]
    lying[2], lying[7:] = 0.1, np.tile([0.2, 1.3, -2.69], 4) * np.tile([1, 1, 1, -1, 1, 1], 2)
    scenario = Scenario(
        'stand', '', 0, 9.0, 'lockstep', 'bullet', 0.1, (Robot('a1', (0.0, 0.0), 0.0),),
        world=World(),
    )  # fmt: skip
    world = BulletWorld(scenario, SimulatorParameters(), [lying])
    bench = Bench()
    bench.order(Order.ARM)
    heights, tilts, torques = [], [], []
    for cycle in range(7000):
        robot = world.states()[0]
        bench.state = told(
            position=robot.configuration[7:],
            velocity=robot.velocity[6:],
            torque=robot.torques,
            orientation=robot.configuration[3:7],
        )
        if cycle == 4000:
            bench.order(Order.SIT_DOWN)
        bench.cycle()
        torque = bench.joint_torque()
        world.step(torque[None])
        heights.append(robot.configuration[2])
        tilts.append(2.0 * math.hypot(*robot.configuration[3:5]))
        torques.append(np.abs(torque).max())
    world.close()
    assert heights[500] < 0.12  # it did lie
    assert height - 0.015 < heights[3900] < height + 0.005  # stiff joints give 9 mm
    assert heights[-1] < 0.12
    assert max(tilts) < math.radians(3.0)
    assert max(torques) < 15.0
