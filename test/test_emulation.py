"""An emulated A1 obeys, errs and fails as its scenario says, and as physics has it."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from layered_cbf_ros.interfaces import NS_PER_S, RobotState
from layered_cbf_ros.plants.a1.frames import MOTOR_OFF, OVERHEATED, SERVO, LowCommand
from layered_cbf_ros.plants.a1.packets import CommandPacker, unpack_state
from layered_cbf_ros.plants.a1.remote import pressed_buttons
from layered_cbf_ros.plants.bullet_world import STEP_NS, BulletWorld, ImuReading
from layered_cbf_ros.plants.emulation.channel import OVERTAKEN_NS, Channel
from layered_cbf_ros.plants.emulation.emulated_a1 import ANSWERED_NS, EmulatedA1
from layered_cbf_ros.plants.emulation.lying import lying_configuration, placed
from layered_cbf_ros.plants.emulation.motors import BRAKE, HOTTEST, Motors, joint_torques
from layered_cbf_ros.plants.emulation.sensors import Sensors
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import FALLEN_HEIGHT, RobotModel
from layered_cbf_ros.scenario import Robot, Scenario
from layered_cbf_ros.scenario_emulation import Emulation, RemotePress

DRIVER = ('127.0.0.1', 8080)
MS = 1_000_000
NOTHING = Emulation()


def rng(seed=0):
    return np.random.default_rng(seed)


def test_a_motor_sums_torque_spring_and_damper():
    command = LowCommand(SERVO, *(np.full(12, x) for x in (0.5, 2.0, 3.0, 100.0, 4.0)))
    torques = joint_torques(command, np.full(12, 0.4), np.full(12, 1.5))
    assert torques == pytest.approx(3.0 + 100.0 * 0.1 + 4.0 * 0.5)


def test_the_makers_off_values_switch_their_loop_off_and_no_other():
    nothing, kp, kd = np.zeros(12), np.full(12, 100.0), np.full(12, 4.0)
    no_position = LowCommand(SERVO, np.full(12, 2.146e9), nothing, nothing, kp, kd)
    assert joint_torques(no_position, nothing, np.ones(12)) == pytest.approx(-4.0)
    no_velocity = LowCommand(SERVO, nothing, np.full(12, 16000.0), nothing, kp, kd)
    assert joint_torques(no_velocity, np.ones(12), np.ones(12)) == pytest.approx(-100.0)


@pytest.mark.parametrize('command', [None, LowCommand.off()])
def test_motors_that_are_off_only_brake(command):
    velocity = np.linspace(-2.0, 2.0, 12)
    torques = joint_torques(command, np.ones(12), velocity)
    assert (torques * velocity <= 0.0).all()
    assert torques == pytest.approx(-BRAKE * velocity)


def test_a_motor_that_works_hard_gets_hot_protects_itself_and_cools_down():
    motors, seconds = Motors.cold(25.0), 0
    while motors.temperature.max() <= HOTTEST:
        motors, seconds = motors.after(np.full(12, 24.0), 1.0), seconds + 1
    assert 10 < seconds < 120
    assert (motors.modes(LowCommand.damping(1.0)) == OVERHEATED).all()
    assert motors.limited(np.full(12, 20.0), np.ones(12), 33.5) == pytest.approx(-BRAKE)
    rested = motors.after(np.zeros(12), 1.0)
    assert (rested.temperature < motors.temperature).all()
    standing = Motors.cold(25.0)
    for _ in range(600):
        standing = standing.after(np.full(12, 6.0), 1.0)
    assert standing.temperature.max() < 45.0  # ten minutes of standing


def state(stamp_ns=0, feet=(30.0, 30.0, 30.0, 30.0)):
    configuration = np.concatenate(([0, 0, 0.28, 0, 0, 0, 1], np.linspace(-1, 1, 12)))
    velocity = np.concatenate((np.zeros(6), np.linspace(1, -1, 12)))
    return RobotState(stamp_ns, configuration, velocity, np.linspace(-3, 3, 12), np.array(feet))


def imu(rotation=None):
    turn = Rotation.identity() if rotation is None else rotation
    return ImuReading(turn.as_quat(), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 9.81]))


def test_perfect_sensors_tell_the_truth_but_for_the_heading_at_the_start():
    measured = Sensors(NOTHING, rng()).read(state(), imu())
    np.testing.assert_array_equal(measured.joints[0], state().configuration[7:])
    np.testing.assert_array_equal(measured.joints[1], state().velocity[6:])
    np.testing.assert_array_equal(measured.foot_forces, state().foot_forces)
    np.testing.assert_array_equal(measured.angular_velocity, imu().angular_velocity)
    up = Rotation.from_quat(measured.orientation).apply([0.0, 0.0, 1.0])
    assert up == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


def test_noise_has_its_size_and_biases_stay():
    emulation = Emulation(
        encoder_noise=0.01, encoder_velocity_noise=0.1, gyro_noise=0.02, gyro_bias=0.05,
        accelerometer_noise=0.3, accelerometer_bias=0.2, foot_force_noise=3.0,
    )  # fmt: skip
    sensors = Sensors(emulation, rng(1))
    readings = [sensors.read(state(), imu()) for _ in range(2000)]
    angles = np.array([r.joints[0] for r in readings]) - state().configuration[7:]
    assert angles.std() == pytest.approx(0.01, rel=0.05)
    rates = np.array([r.joints[1] for r in readings]) - state().velocity[6:]
    assert rates.std() == pytest.approx(0.1, rel=0.05)
    gyro = np.array([r.angular_velocity for r in readings]) - imu().angular_velocity
    assert gyro.std(axis=0) == pytest.approx(0.02, rel=0.1)
    assert np.linalg.norm(gyro.mean(axis=0)) == pytest.approx(0.05, abs=0.003)
    force = np.array([r.specific_force for r in readings]) - imu().specific_force
    assert np.linalg.norm(force.mean(axis=0)) == pytest.approx(0.2, abs=0.03)
    feet = np.array([r.foot_forces for r in readings]) - 30.0
    assert feet.std() == pytest.approx(3.0, rel=0.05)


def test_the_imu_leans_by_its_bias_and_its_heading_drifts():
    emulation = Emulation(tilt_bias=0.02, yaw_drift=0.01)
    sensors, true = Sensors(emulation, rng(2)), Rotation.from_euler('zyx', [0.7, 0.1, -0.2])

    def read(seconds):
        quaternion = sensors.read(state(seconds * NS_PER_S), imu(true)).orientation
        return Rotation.from_quat(quaternion)

    up = np.array([0.0, 0.0, 1.0])
    lean = np.arccos(read(0).inv().apply(up) @ true.inv().apply(up))
    assert lean == pytest.approx(0.02, abs=1e-4)
    turned = read(10) * read(0).inv()
    assert turned.magnitude() == pytest.approx(0.1, abs=1e-6)
    assert abs(turned.as_rotvec()[2]) == pytest.approx(0.1, abs=1e-6)  # about the vertical


def sent(channel, count, apart_ns=MS):
    """Send numbered packets, and return who arrived when."""
    arrived = []
    for k in range(count + 100):
        if k < count:
            channel.put(k * apart_ns, k.to_bytes(4, 'big'), k)
        arrived += [(k, packet, label) for packet, label in channel.due(k * apart_ns)]
    return arrived


def test_a_packet_takes_its_latency_and_keeps_its_turn_though_that_varies():
    arrived = sent(Channel(Emulation(latency=0.005), rng()), 50)
    assert [(when - label) for when, _, label in arrived] == [5] * 50
    arrived = sent(Channel(Emulation(latency=0.005, jitter=0.004), rng()), 500)
    labels = [label for _, _, label in arrived]
    assert labels == sorted(labels)
    delays = [when - label for when, _, label in arrived]
    assert min(delays) >= 5
    assert 8 <= max(delays) <= 10  # due between two looks


@pytest.mark.parametrize(
    ('emulation', 'count'),
    [(Emulation(loss=0.2), 0.8), (Emulation(duplication=0.1), 1.1), (NOTHING, 1.0)],
)
def test_so_many_packets_arrive_as_chance_lets(emulation, count):
    arrived = len(sent(Channel(emulation, rng(3)), 4000))
    assert arrived == pytest.approx(4000 * count, abs=4 * 40)  # four deviations


def test_packets_are_overtaken_and_spoilt_by_a_single_bit():
    arrived = sent(Channel(Emulation(reordering=0.05), rng(4)), 2000)
    late = [label for when, _, label in arrived if when - label == OVERTAKEN_NS // MS]
    assert 50 < len(late) < 150
    labels = [label for _, _, label in arrived]
    assert labels != sorted(labels)
    arrived = sent(Channel(Emulation(corruption=0.1), rng(5)), 2000)
    wrong = [p for _, p, label in arrived if p != label.to_bytes(4, 'big')]
    assert 120 < len(wrong) < 280
    flipped = [
        (int.from_bytes(p, 'big') ^ label).bit_count()
        for _, p, label in arrived
        if p != label.to_bytes(4, 'big')
    ]
    assert Counter(flipped) == {1: len(wrong)}


class Bench:
    """One emulated robot in its world, and what its driver hears."""

    def __init__(self, emulation=NOTHING, start=None):
        robot = Robot('a1_0', (0.0, 0.0))
        scenario = Scenario('', '', 0, 9.0, 'real_time', 'bullet', 0.1, (robot,))
        nominal = RobotModel().nominal_configuration(np.zeros(2), 0.0)
        parameters = SimulatorParameters(exact_within=0.0)
        self.world = BulletWorld(scenario, parameters, [nominal if start is None else start])
        self.robot = EmulatedA1('a1_0', emulation, 33.5, 1)
        self.packer = CommandPacker(33.5)
        self.heard = []

    @property
    def state(self):
        return self.world.states()[0]

    def steps(self, count, command=None):
        for _ in range(count):
            self.heard += self.robot.answers(self.state, self.world.imu(0))
            packets = [] if command is None else [(self.packer.pack(command), DRIVER)]
            self.robot.hear(self.state.stamp_ns, packets)
            self.world.step(self.robot.torques(self.state, STEP_NS / NS_PER_S)[None])

    def close(self):
        self.world.close()


@pytest.fixture
def bench():
    made = []

    def make(*arguments):
        made.append(Bench(*arguments))
        return made[-1]

    yield make
    for each in made:
        each.close()


def holding(configuration):
    none = np.zeros(12)
    return LowCommand(SERVO, configuration[7:], none, none, np.full(12, 100.0), np.full(12, 3.0))


def test_a_robot_that_is_held_stands_and_tells_what_it_does(bench):
    it = bench()
    pose = it.state.configuration.copy()
    it.steps(1000, holding(pose))
    assert it.state.configuration[2] == pytest.approx(pose[2], abs=0.02)
    packet, to = it.heard[-1]
    told = unpack_state(packet)
    assert to == DRIVER
    assert (told.mode == SERVO).all()
    np.testing.assert_allclose(told.position, it.state.configuration[7:], atol=1e-3)
    assert told.foot_force.sum() == pytest.approx(12.458 * 9.81, rel=0.05)  # its weight
    assert told.specific_force[2] == pytest.approx(9.81, abs=0.3)


def test_before_the_first_command_it_is_silent_and_limp(bench):
    it = bench()
    it.steps(1000)
    assert not it.heard
    assert it.state.configuration[2] < 0.2


def test_who_hears_no_commands_any_more_switches_off_and_sinks(bench):
    it = bench(Emulation(command_timeout=0.05))
    pose = it.state.configuration.copy()
    it.steps(300, holding(pose))
    it.steps(50)
    assert unpack_state(it.heard[-1][0]).mode[0] == SERVO
    it.steps(5)
    assert it.robot.timeouts == 1
    it.steps(1)
    assert unpack_state(it.heard[-1][0]).mode[0] == MOTOR_OFF
    it.steps(1500)
    assert it.state.configuration[2] < 0.2
    assert it.state.stamp_ns - ANSWERED_NS > 300 * MS
    before = len(it.heard)
    it.steps(10)
    assert len(it.heard) == before  # it has given its driver up


def test_a_spoilt_command_is_as_none(bench):
    it = bench()
    packet = bytearray(it.packer.pack(holding(it.state.configuration)))
    packet[100] ^= 4
    it.robot.hear(0, [(bytes(packet), DRIVER), (b'short', DRIVER)])
    assert it.robot.command is None
    assert it.robot.refused == {'checksum': 1, 'length': 1}


def test_standing_survives_that_every_fifth_packet_is_lost(bench):
    it = bench(Emulation(loss=0.2, latency=0.001))
    pose = it.state.configuration.copy()
    it.steps(2000, holding(pose))
    assert it.robot.timeouts == 0
    assert it.state.configuration[2] == pytest.approx(pose[2], abs=0.02)


def test_the_remote_control_is_in_the_state_while_it_is_pressed(bench):
    press = RemotePress('a1_0', 0.1, 0.05, ('L2', 'B'))
    it = bench(Emulation(remote=(press, RemotePress('a1_1', 0.0, 9.0, ('R2',)))))
    it.steps(200, holding(it.state.configuration.copy()))
    held = [pressed_buttons(unpack_state(packet).remote) for packet, _ in it.heard]
    assert held.count({'L2', 'B'}) == pytest.approx(50, abs=1)
    assert held.count(frozenset()) == len(held) - held.count({'L2', 'B'})


def test_the_same_seed_errs_the_same_and_another_does_not(bench):
    emulation = Emulation(encoder_noise=0.01, loss=0.1, gyro_noise=0.1)
    first, again = bench(emulation), bench(emulation)
    other = bench(emulation)
    other.robot = EmulatedA1('a1_0', emulation, 33.5, 2)
    for it in (first, again, other):
        it.steps(100, holding(it.state.configuration.copy()))
    assert first.heard == again.heard
    assert first.heard != other.heard


def test_a_robot_lies_at_rest_until_it_is_stood_up(bench):
    lying = lying_configuration()
    assert lying[2] < FALLEN_HEIGHT
    it = bench(NOTHING, lying)
    it.steps(1000)
    assert np.abs(it.state.configuration[:3] - lying[:3]).max() < 0.01
    assert np.abs(it.state.velocity).max() < 0.05


def test_lying_somewhere_else_is_lying_the_same_way():
    lying = lying_configuration()
    moved = placed(lying, (1.0, -2.0), 0.5)
    turn = Rotation.from_quat(moved[3:7]) * Rotation.from_quat(lying[3:7]).inv()
    assert turn.as_rotvec() == pytest.approx([0.0, 0.0, 0.5])
    assert moved[:3] == pytest.approx([1.0, -2.0, lying[2]])
    np.testing.assert_array_equal(moved[7:], lying[7:])
