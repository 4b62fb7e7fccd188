"""nav_msgs/Odometry of a base that moves in the plane, by REP-105.

The pose is in the frame of the header, the twist in that of the base, child_frame_id.
"""

from __future__ import annotations

import math

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import Array, BaseState
from layered_cbf_ros.messages.cdr import CdrReader, CdrWriter, FixedLayout, stamp_of

POSE, COVARIANCE, TWIST = 7, 36, 6
NUMBERS = POSE + COVARIANCE + TWIST + COVARIANCE
TWIST_START = POSE + COVARIANCE
LINEAR = slice(TWIST_START, TWIST_START + 3)
TURN = TWIST_START + 5
QUATERNION_TOLERANCE = 1e-3
MOTION = np.r_[0:POSE, TWIST_START : TWIST_START + TWIST]
"""Places of pose and twist, without their covariances, among all numbers."""


def base_frame(robot: str) -> str:
    """Return the frame of a robot's base."""
    return f'{robot}/base_link'


class OdometryWriter:
    """Encodes the odometry of one base."""

    def __init__(self, robot: str, frame: str = 'world') -> None:
        writer = CdrWriter()
        writer.header(frame)
        writer.text(base_frame(robot))
        writer.fixed(NUMBERS)
        self._layout = FixedLayout(writer.data, writer.blocks)
        self._numbers = np.zeros(NUMBERS)

    def encode(self, state: BaseState) -> bytes:
        """Return the message; the velocity is turned into the frame of the base."""
        c, s = math.cos(state.yaw), math.sin(state.yaw)
        (x, y), (vx, vy) = state.position.tolist(), state.velocity.tolist()
        numbers = self._numbers
        numbers[:2] = x, y
        numbers[5:7] = math.sin(0.5 * state.yaw), math.cos(0.5 * state.yaw)
        numbers[LINEAR] = c * vx + s * vy, c * vy - s * vx, 0.0
        numbers[TURN] = state.yaw_rate
        return self._layout.encode(state.stamp_ns, numbers)


class OdometryReader:
    """Reads the odometry of one base; a steady sender costs only a comparison."""

    def __init__(self, robot: str, frame: str = 'world') -> None:
        """Begin.

        Args:
            robot: Whose it is.
            frame: Frame that all robots share; poses in any other are refused.
        """
        self._robot, self._frame = robot, frame
        self._layout: FixedLayout | None = None

    def read(self, data: bytes) -> BaseState:
        """Return the motion of the base in the world.

        Raises:
            MessageError: If the message is malformed, in another frame, not finite or
                without an orientation.
        """
        layout = self._layout
        if layout is None or not layout.fits(data):
            layout = self._learn(data)
        (numbers,) = layout.arrays(data)
        motion = numbers[MOTION]
        if not math.isfinite(float(motion.sum())):
            raise MessageError(f"odometry of '{self._robot}' has a value that is not finite")
        quaternion = motion[3:7]
        if abs(float(quaternion @ quaternion) - 1.0) > QUATERNION_TOLERANCE:
            raise MessageError(f"odometry of '{self._robot}': orientation is no unit quaternion")
        yaw, velocity = _in_world(quaternion, motion[7:10])
        return BaseState(stamp_of(data), motion[:2], velocity, yaw, float(motion[12]))

    def _learn(self, data: bytes) -> FixedLayout:
        reader = CdrReader(data)
        frame = reader.frame()
        child = reader.text()
        what = f"odometry of '{self._robot}'"
        if frame != self._frame:
            raise MessageError(
                f"{what} is in frame '{frame}'; send it in '{self._frame}', which all robots "
                'share, or set world_frame'
            )
        if child in ('', frame):
            raise MessageError(
                f"{what} has child_frame_id '{child}'; name the base: its twist is in that frame"
            )
        reader.fixed(NUMBERS)
        self._layout = FixedLayout(data, reader.blocks)
        return self._layout


def _in_world(quaternion: Array, linear: Array) -> tuple[float, Array]:
    """Return the heading [rad] and the velocity in the plane of the world [m/s], (2,)."""
    x, y, z, w = quaternion.tolist()
    a, b, c = linear.tolist()
    forward = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
    left = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
    up = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    velocity = [forward[k] * a + left[k] * b + up[k] * c for k in range(2)]
    return math.atan2(forward[1], forward[0]), np.array(velocity)
