"""Obstacles out of two message types: points of the plane, and tracks."""

from __future__ import annotations

import struct

import numpy as np

from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.messages.cdr import CdrReader

POSE = 7
"""Doubles of a geometry_msgs/Pose."""

ODOMETRY = struct.Struct('<85d')
"""All numbers of a nav_msgs/Odometry: pose, 6 x 6 covariance, twist, 6 x 6 covariance."""

TRACK_FIELDS = ('x', 'y', 'vx', 'vy', 'xx', 'xy', 'yy', 'uu', 'uv', 'vv')
"""Position [m], velocity [m/s] in the world, and their covariances."""

_PLACES = [0, 1, 43, 44, 7, 8, 14, 49, 50, 56]  # of these fields among the 85 numbers


class _Rows:
    """Gathers one row of numbers a message; rows may differ in length."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._rows: list[Array] = []

    def add(self, data: bytes) -> None:
        """Take one message.

        Raises:
            MessageError: If it is malformed.
        """
        stamp_ns, row = self._read(data)
        self._stamps.append(stamp_ns)
        self._rows.append(row)

    def build(self) -> Series | None:
        """Return all that was taken, names '0', '1', ..., None if it was nothing."""
        if not self._stamps:
            return None
        most = max(row.shape[1] for row in self._rows)
        values = np.full((len(self._rows), self._rows[0].shape[0], most), np.nan)
        for value, row in zip(values, self._rows, strict=True):
            value[:, : row.shape[1]] = row
        return Series(tuple(map(str, range(most))), np.array(self._stamps, np.int64), values)

    def _read(self, data: bytes) -> tuple[int, Array]:
        """Return stamp [ns] and numbers, (fields, names)."""
        raise NotImplementedError


class Points(_Rows):
    """geometry_msgs/PoseArray; fields are x and y [m]."""

    def _read(self, data: bytes) -> tuple[int, Array]:
        reader = CdrReader(data)
        stamp_ns = reader.header()
        return stamp_ns, reader.doubles(POSE).reshape(-1, POSE)[:, :2].T


class TrackStates(_Rows):
    """nav_msgs/Odometry of one track; fields are TRACK_FIELDS."""

    def _read(self, data: bytes) -> tuple[int, Array]:
        stamp_ns = CdrReader(data).header()
        numbers = np.array(ODOMETRY.unpack_from(data, len(data) - ODOMETRY.size))
        return stamp_ns, numbers[_PLACES][:, None]


def track_name(data: bytes) -> str:
    """Return the child_frame_id of a nav_msgs/Odometry, which names the track.

    Raises:
        MessageError: If the message is too short for its numbers, or they aren't
            aligned where it ends.
    """
    reader = CdrReader(data)
    reader.header()
    name = reader.text()
    if len(data) < ODOMETRY.size or (len(data) - ODOMETRY.size) % 8 != 4:
        raise MessageError(f'message of {len(data)} bytes is no Odometry')
    return name
