"""geometry_msgs/TwistStamped: a velocity in the plane, in the frame of a base."""

from __future__ import annotations

import math

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.messages.cdr import CdrReader, CdrWriter, FixedLayout, stamp_of

NUMBERS = 6
PLANE = np.array([0, 1, 5])
"""Places of forward, left and yaw rate in a twist."""


class TwistWriter:
    """Encodes the velocities of one base."""

    def __init__(self, frame: str) -> None:
        writer = CdrWriter()
        writer.header(frame)
        writer.fixed(NUMBERS)
        self._layout = FixedLayout(writer.data, writer.blocks)
        self._numbers = np.zeros(NUMBERS)

    def encode(self, stamp_ns: int, velocity: Array) -> bytes:
        """Return the message.

        Args:
            stamp_ns: Stamp of the state that it was computed from [ns].
            velocity: Forward, left [m/s] and yaw rate [rad/s], (3,).
        """
        self._numbers[PLANE] = velocity
        return self._layout.encode(stamp_ns, self._numbers)


def read_twist(data: bytes) -> tuple[int, Array]:
    """Return stamp [ns], and forward, left [m/s] and yaw rate [rad/s], (3,).

    Raises:
        MessageError: If the message is malformed or not finite.
    """
    reader = CdrReader(data)
    reader.header()
    velocity = reader.fixed(NUMBERS)[PLANE]
    if not math.isfinite(float(velocity.sum())):
        raise MessageError('velocity has a value that is not finite')
    return stamp_of(data), velocity
