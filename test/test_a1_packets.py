"""The bytes that an A1 understands, held against the maker's own and a packer written by hand."""

import hashlib
import struct

import numpy as np
import pinocchio
import pytest

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.plants.a1.checksum import checksum
from layered_cbf_ros.plants.a1.frames import MOTOR_OFF, SERVO, LowCommand, LowState
from layered_cbf_ros.plants.a1.packets import (
    COMMAND_BYTES,
    STATE_BYTES,
    CommandPacker,
    FrameError,
    pack_state,
    unpack_command,
    unpack_state,
)
from layered_cbf_ros.plants.a1.remote import pressed_buttons, read_remote, write_remote

LEGS = {'FR': 0, 'FL': 1, 'RR': 2, 'RL': 3}  # the robot's order
PARTS = {'hip': 0, 'upper': 1, 'lower': 2}
PLACE = [LEGS[n[:2]] * 3 + PARTS[n.split('_')[1]] for n in JOINT_NAMES]


def crc_by_hand(data):
    """CRC-32/MPEG-2 over little-endian words, bit by bit."""
    crc = 0xFFFFFFFF
    for (word,) in struct.iter_unpack('<I', data):
        for bit in range(31, -1, -1):
            top = (crc >> 31) ^ (word >> bit & 1)
            crc = (crc << 1) & 0xFFFFFFFF ^ (0x04C11DB7 if top else 0)
    return crc


def sealed(data):
    words = len(data) // 4 - 1
    return data[:-4] + struct.pack('<I', crc_by_hand(data[: 4 * words]))


def command_by_hand(command):
    """The maker's layout, written with struct and nothing of ours."""
    motors = [(SERVO, 2.146e9, 16000.0, 0, 0, 0)] * 20
    for k, place in enumerate(PLACE):
        motors[place] = (
            command.mode,
            command.position[k],
            command.velocity[k],
            int(command.torque[k] * 256),  # towards zero
            int(command.kp[k] * 32),
            int(command.kd[k] * 16),
        )
    body = struct.pack('<BHHIB', 0xFF, 0, 0, 0, 0)
    body += b''.join(struct.pack('<BffhhhIII', *motor, 0, 0, 0) for motor in motors)
    return sealed(body + bytes(12 + 40 + 4 + 4))


def random_command(rng, scale=1.0):
    return LowCommand(
        SERVO,
        rng.uniform(-3, 3, 12),
        rng.uniform(-20, 20, 12),
        scale * rng.uniform(-30, 30, 12),
        rng.uniform(0, 200, 12),
        rng.uniform(0, 10, 12),
    )


def random_state(rng):
    quaternion = rng.normal(size=4)
    return LowState(
        int(rng.integers(2**32)),
        rng.integers(0, 11, 12),
        rng.uniform(-3, 3, 12).astype(np.float32).astype(float),
        rng.uniform(-20, 20, 12).astype(np.float32).astype(float),
        rng.integers(-9000, 9000, 12) / 256,
        rng.integers(-20, 90, 12),
        quaternion / np.linalg.norm(quaternion),
        rng.normal(size=3).astype(np.float32).astype(float),
        rng.normal(size=3).astype(np.float32).astype(float),
        rng.integers(-100, 300, 4).astype(float),
        rng.bytes(40),
    )


def test_the_makers_own_first_frame_comes_out_byte_for_byte():
    blank = CommandPacker(33.5).blank()
    assert len(blank) == COMMAND_BYTES
    assert blank[-4:] == struct.pack('<I', 0x1359692F)
    digest = hashlib.sha256(blank).hexdigest()
    assert digest == 'a9528f9b50cba8ce1b69c94c881d6599aa562ee40fa1f18be638992aced83ecc'
    assert checksum(b'\0' + blank[1:604]) == 0x77DB73E3
    assert checksum(bytes(604)) == 0xC0038EC9


@pytest.mark.parametrize('seed', range(20))
def test_commands_are_what_a_hand_written_packer_makes_of_them(seed):
    command = random_command(np.random.default_rng(seed))
    assert CommandPacker(33.5).pack(command) == command_by_hand(command)


@pytest.mark.parametrize('seed', range(20))
def test_commands_survive_the_wire_as_finely_as_its_integers_allow(seed):
    command = random_command(np.random.default_rng(seed))
    heard = unpack_command(CommandPacker(33.5).pack(command))
    assert heard.mode == SERVO
    np.testing.assert_allclose(heard.position, command.position, rtol=1e-7)
    np.testing.assert_allclose(heard.velocity, command.velocity, rtol=1e-7)
    for name, step in (('torque', 1 / 256), ('kp', 1 / 32), ('kd', 1 / 16)):
        wanted, found = getattr(command, name), getattr(heard, name)
        assert (np.abs(found) <= np.abs(wanted)).all()  # towards zero, never beyond
        assert (np.abs(wanted - found) < step).all()


def test_torques_are_cut_where_the_makers_code_lets_them_wrap():
    """200 Nm would arrive as -56 Nm."""
    command = LowCommand(SERVO, *(np.full(12, x) for x in (1.0, 1.0, 200.0, 2000.0, 5000.0)))
    heard = unpack_command(CommandPacker(33.5).pack(command))
    assert heard.torque == pytest.approx(33.5)
    widest = unpack_command(CommandPacker(1e9).pack(command))
    assert ((widest.torque > 127.9) & (widest.torque < 128.0)).all()
    assert ((widest.kp > 1000.0) & (widest.kd > 2000.0)).all()
    lowest = LowCommand(SERVO, *(np.full(12, x) for x in (-1.0, -1.0, -200.0, -1.0, -1.0)))
    heard = unpack_command(CommandPacker(33.5).pack(lowest))
    assert heard.torque == pytest.approx(-33.5)
    assert not heard.kp.any()  # negative gains would drive a joint away
    assert not heard.kd.any()


@pytest.mark.parametrize(
    ('name', 'value', 'gain'),
    [('position', 2.146e9, 'kp'), ('position', -33.0, 'kp'), ('velocity', 16000.0, 'kd')],
)
def test_no_motor_with_a_gain_is_ever_told_the_value_that_switches_its_loop_off(name, value, gain):
    """Were it taken at its word, the joint would go to its stop with all it has."""
    packer = CommandPacker(33.5)
    command = LowCommand(SERVO, *np.zeros((5, 12)))
    getattr(command, name)[7], getattr(command, gain)[7] = value, 5.0
    with pytest.raises(MessageError, match=rf'{name} of RL_upper_joint is .* with {gain} 5;'):
        packer.pack(command)
    getattr(command, gain)[7] = 0.0  # without a gain the value means nothing
    assert np.abs(getattr(unpack_command(packer.pack(command)), name)).max() <= 128.0


@pytest.mark.parametrize('name', ['position', 'velocity', 'torque', 'kp', 'kd'])
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_never_packed_and_named(name, bad):
    packer, command = CommandPacker(33.5), random_command(np.random.default_rng(1))
    getattr(command, name)[4] = bad
    with pytest.raises(MessageError, match=f'{name} of FR_upper_joint is'):
        packer.pack(command)
    good = random_command(np.random.default_rng(2))
    assert packer.pack(good) == command_by_hand(good)  # nothing of it is left


def test_a_world_that_has_burst_is_not_packed():
    state = random_state(np.random.default_rng(1))
    state.velocity[3] = np.nan
    with pytest.raises(MessageError, match='velocity of a state'):
        pack_state(state)


def test_states_beyond_their_integers_are_clamped():
    """A motor of 130 degrees must not read as one of -126."""
    state = random_state(np.random.default_rng(1))
    state.temperature[:], state.torque[:], state.foot_force[:] = 130, 200.0, 1e6
    heard = unpack_state(pack_state(state))
    assert (heard.temperature == 127).all()
    assert (heard.torque > 127.9).all()
    assert (heard.foot_force == 32767.0).all()


def test_damping_resists_motion_and_off_is_off():
    damping = unpack_command(CommandPacker(33.5).pack(LowCommand.damping(3.0)))
    assert damping.mode == SERVO
    assert (damping.kd == 3.0).all()
    assert not np.concatenate((damping.velocity, damping.kp, damping.torque)).any()
    off = unpack_command(CommandPacker(33.5).pack(LowCommand.off()))
    assert off.mode == MOTOR_OFF
    assert not np.concatenate((off.kd, off.kp, off.torque)).any()


@pytest.mark.parametrize('seed', range(20))
def test_states_come_back_to_the_bit(seed):
    state = random_state(np.random.default_rng(seed))
    packet = pack_state(state)
    assert len(packet) == STATE_BYTES
    heard = unpack_state(packet)
    for name in ('tick', 'remote'):
        assert getattr(heard, name) == getattr(state, name)
    for name in (
        *('mode', 'position', 'velocity', 'torque', 'temperature'),
        *('angular_velocity', 'specific_force', 'foot_force'),
    ):
        np.testing.assert_array_equal(getattr(heard, name), getattr(state, name), err_msg=name)
    np.testing.assert_allclose(heard.orientation, state.orientation, atol=1e-7)


def test_each_field_of_a_state_stands_where_the_maker_has_it():
    data = bytearray(STATE_BYTES)
    struct.pack_into('<4f', data, 10, 0.5, 0.1, -0.7, 0.5)  # w, x, y, z
    struct.pack_into('<3f', data, 26, 1.0, 2.0, 3.0)
    struct.pack_into('<3f', data, 38, 4.0, 5.0, 6.0)
    for k in range(12):
        at = 63 + 32 * k
        struct.pack_into('<Bffhh', data, at, 10, k, 10.0 * k, 0, 256 * k)
        struct.pack_into('<b', data, at + 23, 30 + k)
    struct.pack_into('<4h', data, 703, 11, 22, 33, 44)  # FR, FL, RR, RL
    struct.pack_into('<I', data, 719, 12345)
    state = unpack_state(sealed(bytes(data)))
    x, y, z, w = state.orientation
    assert (w, x, y, z) == pytest.approx((0.5, 0.1, -0.7, 0.5))
    assert state.angular_velocity.tolist() == [1.0, 2.0, 3.0]
    assert state.specific_force.tolist() == [4.0, 5.0, 6.0]
    assert state.position.tolist() == PLACE
    assert state.velocity.tolist() == [10.0 * k for k in PLACE]
    assert state.torque.tolist() == PLACE
    assert state.temperature.tolist() == [30 + k for k in PLACE]
    assert state.foot_force.tolist() == [22.0, 11.0, 44.0, 33.0]  # FL, FR, RL, RR
    assert state.tick == 12345


@pytest.mark.parametrize('seed', range(5))
def test_a_packed_state_has_roll_pitch_and_yaw_of_its_orientation(seed):
    state = random_state(np.random.default_rng(seed))
    turned = pinocchio.Quaternion(state.orientation).matrix()
    told = struct.unpack_from('<3f', pack_state(state), 50)
    assert told == pytest.approx(pinocchio.rpy.matrixToRpy(turned), abs=1e-5)


def spoilt(change):
    data = bytearray(pack_state(random_state(np.random.default_rng(3))))
    change(data)
    return bytes(data)


@pytest.mark.parametrize(
    ('packet', 'kind'),
    [
        (b'', 'length'),
        (spoilt(lambda data: data.pop()), 'length'),
        (spoilt(lambda data: data.__setitem__(70, data[70] ^ 1)), 'checksum'),
        (sealed(bytes(STATE_BYTES)), 'empty'),
        (sealed(spoilt(lambda data: struct.pack_into('<f', data, 64, np.nan))), 'not_finite'),
        (sealed(spoilt(lambda data: struct.pack_into('<f', data, 38, np.inf))), 'not_finite'),
        (sealed(spoilt(lambda data: struct.pack_into('<f', data, 10, 9.0))), 'not_finite'),
        (sealed(spoilt(lambda data: struct.pack_into('<f', data, 10, np.nan))), 'not_finite'),
    ],
)
def test_a_state_that_is_none_is_refused_and_why(packet, kind):
    with pytest.raises(FrameError) as refused:
        unpack_state(packet)
    assert refused.value.kind == kind


def test_every_single_flipped_bit_is_found():
    packet = pack_state(random_state(np.random.default_rng(4)))
    rng = np.random.default_rng(5)
    for _ in range(200):
        data = bytearray(packet)
        data[rng.integers(764)] ^= 1 << rng.integers(8)
        with pytest.raises(FrameError, match='checksum'):
            unpack_state(bytes(data))


def test_a_command_for_another_level_is_refused():
    packet = bytearray(CommandPacker(33.5).blank())
    packet[0] = 0
    with pytest.raises(FrameError, match='level'):
        unpack_command(sealed(bytes(packet)))


def test_a_command_that_is_not_finite_is_refused():
    packet = bytearray(CommandPacker(33.5).pack(LowCommand.damping(1.0)))
    struct.pack_into('<f', packet, 10 + 27 * 5 + 1, np.nan)
    with pytest.raises(FrameError, match='not finite'):
        unpack_command(sealed(bytes(packet)))


@pytest.mark.parametrize(
    ('bits', 'buttons'),
    [(0x0010, {'R2'}), (0x0220, {'L2', 'B'}), (0x8001, {'left', 'R1'}), (0, set())],
)
def test_buttons_of_the_remote_control_have_the_makers_bits(bits, buttons):
    data = struct.pack('<HH5f', 0, bits, 0.1, 0.3, 0.4, 0.0, 0.2).ljust(40, b'\0')
    assert pressed_buttons(data) == buttons
    assert read_remote(data).sticks == pytest.approx((0.1, 0.2, 0.3, 0.4))
    assert pressed_buttons(write_remote(buttons)) == buttons


def test_a_stick_that_tells_no_number_is_let_go():
    data = struct.pack('<HH5f', 0, 0, np.nan, 7.0, -np.inf, 0.0, -7.0).ljust(40, b'\0')
    assert read_remote(data).sticks == (0.0, -1.0, 1.0, 0.0)
