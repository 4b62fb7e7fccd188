"""What an output of a node says at one stamp: named numbers, with their units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.base_states import Velocities
from layered_cbf_ros.bags.run.series import (
    JointStates,
    JointTrajectories,
    PlannedMotions,
    SeriesBuilder,
)
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.interfaces import Array, Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import track_from
from layered_cbf_ros.node_topics import BARRIERS, DESIRED, INTERVENTION, PLAN, TRACKS

SERIES = (BARRIERS, INTERVENTION, DESIRED)
FORCES, COMMANDS, VELOCITY = 'ground_forces', 'joint_commands', 'cmd_vel_safe'

Quantity = tuple[str, str]  # what a number is, and its unit
Key = tuple[int, str]  # stamp [ns], and part of a row
XYZ = ('x', 'y', 'z')
UNUSED = ('unused', '')
PLAN_FIELDS: tuple[Quantity, ...] = (
    *(('position', 'm') for _ in XYZ),
    *(('orientation', '') for _ in (*XYZ, 'w')),
    *(('velocity', 'm/s') for _ in XYZ),
    *(('angular velocity', 'rad/s') for _ in XYZ),
    *(('acceleration', 'm/s^2') for _ in XYZ),
    *(('angular acceleration', 'rad/s^2') for _ in XYZ),
)
TRACK_FIELDS: tuple[Quantity, ...] = (
    *(('position', 'm') for _ in range(2)),
    *(('velocity', 'm/s') for _ in range(2)),
    *(('covariance of the position', 'm^2') for _ in range(4)),
    *(('covariance of the velocity', 'm^2/s^2') for _ in range(4)),
)
FIELDS: dict[str, tuple[Quantity, ...]] = {
    PLAN: PLAN_FIELDS,
    BARRIERS: (('psi0', 'm'), ('psi1', 'm/s'), ('psi2', 'm/s^2'), ('slack', 'm/s^2')),
    INTERVENTION: (('|u - u_desired|', 'm/s^2'), UNUSED, UNUSED, UNUSED),
    DESIRED: (
        ('applied input', 'm/s^2'),
        ('desired velocity', 'm/s'),
        ('desired input', 'm/s^2'),
        ('held', ''),
    ),
    TRACKS: TRACK_FIELDS,
    COMMANDS: (('joint position', 'rad'), ('joint velocity', 'rad/s'), ('torque', 'Nm')),
    VELOCITY: (*(('velocity', 'm/s') for _ in XYZ), *(('angular velocity', 'rad/s') for _ in XYZ)),
}
FORCE_FIELDS: dict[str, tuple[Quantity, ...]] = {
    'phase': (('swing phase', ''), ('swing rate', '1/s'), UNUSED),
    'com': (('predicted CoM position', 'm'), ('predicted CoM velocity', 'm/s'), UNUSED),
    'rotation': (('predicted rotation', 'rad'), ('predicted angular velocity', 'rad/s'), UNUSED),
    'foot': (('foothold', 'm'), UNUSED, ('force', 'N')),
}


@dataclass(frozen=True, slots=True)
class Row:
    """What a topic tells at one stamp.

    Attributes:
        stamp_ns: The stamp [ns].
        names: What each column belongs to: a robot, a pair, a joint, ...; (n,).
        values: (f, n) for f fields.
        part: Which of several messages with one stamp it is: the name of a track.
    """

    stamp_ns: int
    names: tuple[str, ...]
    values: Array
    part: str = ''


Content = Row | bytes
"""What a topic tells at one stamp: a row, or the message that can be read as one."""


class RowReader:
    """Reads the messages of one output topic."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._decoder = MessageDecoder()
        self._series: SeriesBuilder = JointStates()
        if topic == PLAN:
            self._series = PlannedMotions()
        elif topic in SERIES:
            self._series = JointTrajectories()
        elif topic.rpartition('/')[2] == VELOCITY:
            self._series = Velocities()

    def read(self, record: Record) -> Iterator[Content]:
        """Yield what a recorded message tells, as bytes where it tells of one stamp.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        if self._topic == TRACKS:
            yield track_row(track_from(self._decoder.decode(record), 0.0))
        elif self._topic in SERIES:
            names, stamps, values = self._series.read(record.data)
            for stamp_ns, value in zip(stamps, values, strict=True):
                yield Row(stamp_ns, names, value)
        else:
            yield record.data

    def row(self, content: Content) -> Row:
        """Return a content as a row.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        if isinstance(content, Row):
            return content
        names, (stamp_ns,), (value,) = self._series.read(content)
        return Row(stamp_ns, names, value)


def key_of(content: Content) -> Key:
    """Return stamp [ns] and part of a content.

    Raises:
        MessageError: If it is too short to have a stamp.
    """
    if isinstance(content, Row):
        return content.stamp_ns, content.part
    return stamp_of(content), ''


def series_row(stamp_ns: int, names: Any, arrays: tuple[Array, ...]) -> Row:
    """Return a tick of a JointTrajectory's four fields; those not given are zero."""
    values = np.zeros((4, len(names)))
    values[: len(arrays)] = arrays
    return Row(stamp_ns, tuple(names), values)


def track_row(track: Track) -> Row:
    """Return a track as a row of its own."""
    blocks = track.covariance[:2, :2], track.covariance[2:, 2:]
    values = np.concatenate((track.position, track.velocity, *(b.ravel() for b in blocks)))
    return Row(track.stamp_ns, (track.name,), values[:, None], track.name)


def quantities(topic: str, names: tuple[str, ...]) -> list[Quantity]:
    """Return what the fields of the names are, field by field, (f n,)."""
    kind = topic if topic in FIELDS else topic.rpartition('/')[2]
    if kind == FORCES:
        columns = [_force_fields(name) for name in names]
        return [column[field] for field in range(3) for column in columns]
    return [quantity for quantity in FIELDS[kind] for _ in names]


def same_bits(a: Array, b: Array) -> NDArray[np.bool_]:
    """Tell which doubles are the same to the bit; NaN equals NaN."""
    bits = np.ascontiguousarray(a).view(np.int64) == np.ascontiguousarray(b).view(np.int64)
    same: NDArray[np.bool_] = bits | (np.isnan(a) & np.isnan(b))
    return same


def _force_fields(name: str) -> tuple[Quantity, ...]:
    if name.endswith('_phase'):
        return FORCE_FIELDS['phase']
    return FORCE_FIELDS.get(name.partition('_')[0], FORCE_FIELDS['foot'])
