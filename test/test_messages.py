"""The fixed layouts are ordinary ROS messages, and nothing bad passes them."""

import dataclasses
import math

import numpy as np
import pytest

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import JOINT_NAMES, GroundForcePlan, PlannedMotion, RobotState
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.ground_forces import GroundForceReader, GroundForceWriter
from layered_cbf_ros.messages.joint_state import JointStateReader, JointStateWriter
from layered_cbf_ros.messages.robot_state import StateReader, StateWriter
from layered_cbf_ros.messages.trajectory import TrajectoryReader, TrajectoryWriter

STAMP_NS = 3_000_000_007
ROBOTS = ('a1_0', 'a1_1', 'other')


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def state(rng) -> RobotState:
    configuration = rng.normal(size=19)
    configuration[3:7] /= np.linalg.norm(configuration[3:7])
    return RobotState(
        STAMP_NS, configuration, rng.normal(size=18), rng.normal(size=12), rng.normal(size=4)
    )


def motion(rng) -> PlannedMotion:
    return PlannedMotion(STAMP_NS, *rng.normal(size=(3, 2)), 2.5, -0.3)


def same(a, b) -> bool:
    pairs = zip(dataclasses.astuple(a), dataclasses.astuple(b), strict=True)
    return all(np.array_equal(x, y) for x, y in pairs)


def through_rclpy(data: bytes, message_type: type) -> bytes:
    """Return what rclpy itself makes of the message: an independent codec."""
    serialization = pytest.importorskip('rclpy.serialization')
    message = serialization.deserialize_message(data, message_type)
    return bytes(serialization.serialize_message(message))


@pytest.mark.parametrize('robot', range(3))
def test_states_pass_unchanged_also_through_rclpy(rng, robot):
    from sensor_msgs.msg import JointState

    states = [state(rng) for _ in ROBOTS]
    data = StateWriter(ROBOTS).encode(states)
    reader = StateReader(ROBOTS[robot])
    assert same(reader.read(data), states[robot])
    assert same(reader.read(through_rclpy(data, JointState)), states[robot])


def test_rclpy_reads_the_fields_that_were_meant(rng):
    serialization = pytest.importorskip('rclpy.serialization')
    from sensor_msgs.msg import JointState

    sent = state(rng)
    message = serialization.deserialize_message(StateWriter(['a']).encode([sent]), JointState)
    value = dict(zip(message.name, message.position, strict=True))
    rate = dict(zip(message.name, message.velocity, strict=True))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 7)
    assert value['a/base_qw'] == sent.configuration[6]
    assert value['a/RR_lower_joint'] == sent.configuration[18]
    assert rate['a/base_qz'] == sent.velocity[5]
    assert rate['a/FL_hip_joint'] == sent.velocity[6]


def test_a_plan_passes_unchanged_also_through_rclpy(rng):
    from trajectory_msgs.msg import MultiDOFJointTrajectory

    motions = [motion(rng) for _ in ROBOTS]
    data = TrajectoryWriter(ROBOTS).encode(STAMP_NS, motions)
    for bytes_ in (data, through_rclpy(data, MultiDOFJointTrajectory)):
        read = TrajectoryReader('a1_1').read(bytes_)
        assert np.array_equal(read.position, motions[1].position)
        assert np.array_equal(read.acceleration, motions[1].acceleration)
        assert read.yaw == pytest.approx(2.5, abs=1e-15)
        assert read.yaw_rate == -0.3


@pytest.mark.parametrize('yaw', [-3.1, 0.0, 3.1])
def test_headings_near_the_back_keep_their_sign(rng, yaw):
    sent = dataclasses.replace(motion(rng), yaw=yaw)
    data = TrajectoryWriter(['a']).encode(STAMP_NS, [sent])
    assert TrajectoryReader('a').read(data).yaw == pytest.approx(yaw, abs=1e-12)


def test_forces_pass_unchanged(rng):
    sent = GroundForcePlan(
        STAMP_NS,
        *rng.normal(size=(2, 4, 3)),
        np.array([0.0, 0.5, 0.5, 0.0]),
        np.array([0.0, 5.0, 5.0, 0.0]),
        rng.normal(size=12),
    )
    received = GroundForceReader().read(GroundForceWriter().encode(sent))
    assert same(received, sent)
    assert received.in_stance.tolist() == [True, False, False, True]


def test_entries_are_found_by_name_in_any_order_and_after_a_change(rng):
    reader = JointStateReader(['b', 'a'])
    for names in (['a', 'b'], ['b', 'x', 'a'], ['a', 'b']):
        values = {name: float(i) for i, name in enumerate(names)}
        rows = np.array([list(values.values())] * 3)
        _, read = reader.read(JointStateWriter(names).encode(1, *rows))
        assert read[0].tolist() == [values['b'], values['a']]


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('field', range(3))
def test_values_that_are_not_finite_are_refused(rng, bad, field):
    rows = rng.normal(size=(3, 12))
    rows[field, 7] = bad
    data = JointStateWriter(JOINT_NAMES).encode(STAMP_NS, *rows)
    with pytest.raises(MessageError, match='finite'):
        JointStateReader(JOINT_NAMES).read(data)


def test_infinities_of_both_signs_do_not_cancel(rng):
    rows = rng.normal(size=(3, 12))
    rows[2, :2] = math.inf, -math.inf
    with pytest.raises(MessageError, match='finite'):
        JointStateReader(JOINT_NAMES).read(JointStateWriter(JOINT_NAMES).encode(1, *rows))


def test_an_unknown_joint_is_named(rng):
    data = JointStateWriter(['FL_hip_jiont']).encode(1, *rng.normal(size=(3, 1)))
    with pytest.raises(MessageError, match="no 'FL_hip_joint'"):
        JointStateReader(['FL_hip_joint']).read(data)


def test_a_base_orientation_must_be_a_rotation(rng):
    bad = dataclasses.replace(state(rng), configuration=np.ones(19))
    with pytest.raises(MessageError, match='quaternion'):
        StateReader('a').read(StateWriter(['a']).encode([bad]))


def test_every_truncation_is_refused(rng):
    """No cut, wherever it is, is read as a message, nor read beyond its end."""
    whole = StateWriter(['a']).encode([state(rng)])
    reader = StateReader('a')
    reader.read(whole)
    for length in range(len(whole)):
        with pytest.raises(MessageError):
            reader.read(whole[:length])


def test_random_bytes_are_refused(rng):
    """Damage anywhere in names or lengths is noticed: never another exception."""
    whole = bytearray(StateWriter(['a']).encode([state(rng)]))
    reader = StateReader('a')
    for _ in range(2000):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] = rng.integers(256)
        try:
            reader.read(bytes(damaged))
        except MessageError:
            continue


def test_a_length_that_lies_does_not_allocate(rng):
    data = bytearray(JointStateWriter(['a']).encode(1, *rng.normal(size=(3, 1))))
    data[20:24] = b'\xff\xff\xff\x7f'
    with pytest.raises(MessageError, match='does not fit'):
        JointStateReader(['a']).read(bytes(data))


def test_stamps_are_exact_to_the_nanosecond(rng):
    writer = JointStateWriter(['a'])
    for stamp_ns in (0, 1, 999_999_999, 1_000_000_000, 1_700_000_000_123_456_789):
        assert stamp_of(writer.encode(stamp_ns, *np.zeros((3, 1)))) == stamp_ns
