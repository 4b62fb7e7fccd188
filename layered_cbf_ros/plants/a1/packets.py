"""An A1's packets: frames to bytes and back, 610 bytes a command and 771 a state.

Little-endian, packed, the checksum in the last four bytes. Torques and gains travel as
16-bit integers; the maker's own code lets them wrap, so that 200 Nm would become -56 Nm.
Here they are clamped before, and what is not a number is never packed. Headers are sent
as zeros, as the maker's library does, and not judged: what real robots put there isn't known.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.plants.a1.checksum import checksum
from layered_cbf_ros.plants.a1.frames import SERVO, LowCommand, LowState

COMMAND_BYTES, STATE_BYTES = 610, 771
LOW_LEVEL = 0xFF
MOTORS = 20  # in a packet; an A1 has the first twelve
MOTORS_AT, COMMAND_CHECKED, STATE_MOTORS_AT, STATE_CHECKED = 10, 604, 63, 764
POSITION_OFF, VELOCITY_OFF = 2.146e9, 16000.0
"""Desired angle and velocity that switch a loop off: only for motors without any gain."""
SCALES = np.array([1.0, 1.0, 256.0, 32.0, 16.0])
"""Of position, velocity, torque, kp and kd."""
TORQUE_SCALE = 256.0
WIDEST = np.array([32.0, 128.0, 127.99, 1023.0, 2047.0])
"""Largest position [rad], velocity [rad/s], torque [Nm], kp and kd that are ever sent.

No joint of an A1 gets near the first two.
"""
QUATERNION_TOLERANCE = 0.05

ROBOT_ORDER = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""Our joint at each place of the robot, FR, FL, RR, RL; the way back is the same."""
ROBOT_FEET = np.array([1, 0, 3, 2])

MOTOR_COMMAND = np.dtype([
    ('mode', 'u1'), ('motion', '<f4', 2), ('efforts', '<i2', 3), ('reserve', '<u4', 3),
])  # fmt: skip
MOTOR_STATE = np.dtype([
    ('mode', 'u1'), ('position', '<f4'), ('velocity', '<f4'), ('acceleration', '<i2'),
    ('torque', '<i2'), ('raw_position', '<f4'), ('raw_velocity', '<f4'),
    ('raw_acceleration', '<i2'), ('temperature', 'i1'), ('reserve', '<u4', 2),
])  # fmt: skip
IMU_AT, FEET_AT, TICK_AT, REMOTE_AT = 10, 703, 719, 723
REMOTE_BYTES = 40


class FrameError(MessageError):
    """A packet was refused; `kind` is one word for a counter."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class CommandPacker:
    """Packs commands into a buffer of its own.

    Motors that an A1 doesn't have stay as the maker's library leaves them.
    """

    def __init__(self, torque_limit: float) -> None:
        """Prepare.

        Args:
            torque_limit: Largest torque that is sent [Nm].
        """
        self._buffer = bytearray(COMMAND_BYTES)
        self._buffer[0] = LOW_LEVEL
        motors = np.frombuffer(self._buffer, MOTOR_COMMAND, MOTORS, MOTORS_AT)
        motors['mode'], motors['motion'] = SERVO, (POSITION_OFF, VELOCITY_OFF)
        ours = motors[: len(ROBOT_ORDER)]
        self._mode, self._motion, self._efforts = (ours[n] for n in ('mode', 'motion', 'efforts'))
        widest = WIDEST.copy()
        widest[2] = min(torque_limit, widest[2])
        self._upper = np.repeat(widest * SCALES, len(ROBOT_ORDER))
        self._lower = np.repeat(-widest * SCALES * (1.0, 1.0, 1.0, 0.0, 0.0), len(ROBOT_ORDER))
        self._scale = np.repeat(SCALES, len(ROBOT_ORDER))
        self._order = np.concatenate([ROBOT_ORDER + len(ROBOT_ORDER) * k for k in range(5)])
        self._given, self._values = np.zeros(len(self._order)), np.zeros(len(self._order))
        rows = self._values.reshape(5, -1).T
        self._two, self._three = rows[:, :2], rows[:, 2:]
        self._positions, self._velocities = self._values[:12], self._values[12:24]
        self._checked = memoryview(self._buffer)[:COMMAND_CHECKED]

    def blank(self) -> bytes:
        """Return the packet of no command at all, as the maker's library begins with."""
        return self._sealed()

    def pack(self, command: LowCommand) -> bytes:
        """Return the packet of a command, each value within what may be sent.

        Raises:
            MessageError: If a value isn't finite, or a loop with a gain is given the value
                that switches it off, or another that no joint ever has.
        """
        c, values = command, self._values
        np.concatenate((c.position, c.velocity, c.torque, c.kp, c.kd), out=self._given)
        np.multiply(self._given.take(self._order), self._scale, out=values)
        if not math.isfinite(values.dot(values)):
            raise MessageError(_not_finite(command))
        x, v = self._positions, self._velocities
        if x.dot(x) > WIDEST[0] ** 2 or v.dot(v) > WIDEST[1] ** 2:  # perhaps one is too large
            _refuse_wild(command)
        np.maximum(values, self._lower, out=values)
        np.minimum(values, self._upper, out=values)
        self._motion[:] = self._two
        self._efforts[:] = self._three  # to integers: towards zero, as the maker's library does
        self._mode[:] = command.mode
        return self._sealed()

    def _sealed(self) -> bytes:
        struct.pack_into('<I', self._buffer, COMMAND_BYTES - 4, checksum(self._checked))
        return bytes(self._buffer)


def _not_finite(command: LowCommand) -> str:
    """Name the first value of a command that isn't finite."""
    for name in ('position', 'velocity', 'torque', 'kp', 'kd'):
        for joint, value in zip(JOINT_NAMES, getattr(command, name), strict=True):
            if not math.isfinite(value):
                return f'{name} of {joint} is {value}; send numbers'
    return 'a command is not finite; send smaller numbers'


def _refuse_wild(command: LowCommand) -> None:
    """Raise if a joint would be driven towards a position or velocity that it can't have."""
    c = command
    loops = (('position', c.position, 'kp', c.kp), ('velocity', c.velocity, 'kd', c.kd))
    for widest, (name, values, gain, gains) in zip(WIDEST, loops, strict=False):
        for joint, value, given in zip(JOINT_NAMES, values, gains, strict=True):
            if abs(value) > widest and given > 0.0:
                raise MessageError(
                    f'{name} of {joint} is {value:g} with {gain} {given:g}; '
                    f'send at most {widest:g}, or no {gain}'
                )


def unpack_command(data: bytes) -> LowCommand:
    """Return what a robot is told.

    Raises:
        FrameError: If the packet is none, spoilt, not for the motors, or not finite.
    """
    _check(data, COMMAND_BYTES, COMMAND_CHECKED, 'command')
    if data[0] != LOW_LEVEL:
        raise FrameError('level', f'command is for level {data[0]:#04x}, not for the motors')
    motors = np.frombuffer(data, MOTOR_COMMAND, len(ROBOT_ORDER), MOTORS_AT)[ROBOT_ORDER]
    position, velocity = motors['motion'].astype(np.float64).T
    if not math.isfinite(float(position.sum() + velocity.sum())):
        raise FrameError('not_finite', 'command has a value that is not finite')
    torque, kp, kd = (motors['efforts'] / SCALES[2:]).T
    return LowCommand(int(motors['mode'][0]), position, velocity, torque, kp, kd)


def pack_state(state: LowState) -> bytes:
    """Return the packet of a state, clamped to what its integers can hold.

    Raises:
        MessageError: If a value isn't finite.
    """
    _check_finite(state)
    buffer = bytearray(STATE_BYTES)
    buffer[0] = LOW_LEVEL
    x, y, z, w = state.orientation.tolist()
    imu = (w, x, y, z, *state.angular_velocity, *state.specific_force, *_rpy(x, y, z, w))
    struct.pack_into('<13f', buffer, IMU_AT, *imu)
    motors = np.frombuffer(buffer, MOTOR_STATE, MOTORS, STATE_MOTORS_AT)[: len(ROBOT_ORDER)]
    for name in ('mode', 'position', 'velocity'):
        motors[name] = getattr(state, name)[ROBOT_ORDER]
    motors['raw_position'], motors['raw_velocity'] = motors['position'], motors['velocity']
    motors['temperature'] = np.clip(state.temperature, -128, 127)[ROBOT_ORDER]
    motors['torque'] = _int16(state.torque * TORQUE_SCALE)[ROBOT_ORDER]
    struct.pack_into('<4h', buffer, FEET_AT, *_int16(state.foot_force)[ROBOT_FEET].tolist())
    struct.pack_into('<I', buffer, TICK_AT, state.tick & 0xFFFFFFFF)
    buffer[REMOTE_AT : REMOTE_AT + REMOTE_BYTES] = state.remote
    crc = checksum(memoryview(buffer)[:STATE_CHECKED])
    struct.pack_into('<I', buffer, STATE_BYTES - 4, crc)
    return bytes(buffer)


def _check_finite(state: LowState) -> None:
    for name in (
        *('position', 'velocity', 'torque'),
        *('orientation', 'angular_velocity', 'specific_force', 'foot_force'),
    ):
        values = getattr(state, name)
        if not math.isfinite(values.sum()):
            raise MessageError(f'{name} of a state is {values}; send numbers')


def unpack_state(data: bytes) -> LowState:
    """Return what a robot tells.

    Raises:
        FrameError: If the packet is none, spoilt, all zeros, or not finite.
    """
    _check(data, STATE_BYTES, STATE_CHECKED, 'state')
    w, x, y, z, *imu = struct.unpack_from('<13f', data, IMU_AT)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length == 0.0:
        raise FrameError('empty', 'state has no orientation: the robot has not begun to measure')
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        raise FrameError('not_finite', 'orientation of the state is no unit quaternion')
    motors = np.frombuffer(data, MOTOR_STATE, len(ROBOT_ORDER), STATE_MOTORS_AT)[ROBOT_ORDER]
    position = motors['position'].astype(np.float64)
    velocity = motors['velocity'].astype(np.float64)
    if not math.isfinite(float(position.sum() + velocity.sum()) + sum(imu)):
        raise FrameError('not_finite', 'state has a value that is not finite')
    return LowState(
        struct.unpack_from('<I', data, TICK_AT)[0],
        motors['mode'].astype(np.int64),
        position,
        velocity,
        motors['torque'] / TORQUE_SCALE,
        motors['temperature'].astype(np.int64),
        np.array((x, y, z, w)) / length,
        np.array(imu[:3]),
        np.array(imu[3:6]),
        np.array(struct.unpack_from('<4h', data, FEET_AT), dtype=np.float64)[ROBOT_FEET],
        data[REMOTE_AT : REMOTE_AT + REMOTE_BYTES],
    )


def _check(data: bytes, size: int, checked: int, what: str) -> None:
    if len(data) != size:
        raise FrameError('length', f'{what} has {len(data)} bytes, not {size}')
    crc = struct.unpack_from('<I', data, size - 4)[0]
    if crc != checksum(memoryview(data)[:checked]):
        raise FrameError('checksum', f'{what} has a wrong checksum')


def _int16(values: np.ndarray) -> np.ndarray:
    return np.clip(values, -32768, 32767).astype('<i2')


def _rpy(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of R = Rz(yaw) Ry(pitch) Rx(roll) [rad]."""
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
