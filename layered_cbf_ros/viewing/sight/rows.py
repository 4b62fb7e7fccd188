"""One message, or one point of it, as named numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from layered_cbf_ros.bags.run.series import (
    JointStates,
    JointTrajectories,
    PlannedMotions,
    SeriesBuilder,
)
from layered_cbf_ros.discs import disc_offsets, shared_frame
from layered_cbf_ros.interfaces import Array, PlannedMotion
from layered_cbf_ros.messages.odometry import OdometryReader
from layered_cbf_ros.messages.robot_state import BASE_NAMES
from layered_cbf_ros.node_topics import (
    BALLS,
    BARRIERS,
    CLEARANCE,
    COMMANDS,
    DESIRED,
    INTERVENTION,
    PLAN,
    STATE,
    odometry,
)
from layered_cbf_ros.scenario import LEGGED, Robot, Scenario


@dataclass(frozen=True, slots=True)
class Row:
    """Named quantities at one instant.

    Attributes:
        stamp_ns: When [ns].
        names: Their names, (n,).
        values: (f, n) for f fields; NaN where the message has none.
    """

    stamp_ns: int
    names: tuple[str, ...]
    values: Array

    def picked(self, names: list[str]) -> Array:
        """Return the values of some names, NaN for those that are absent; (f, len(names))."""
        place = {name: i for i, name in enumerate(self.names)}
        picked = np.full((len(self.values), len(names)), np.nan)
        for column, name in enumerate(names):
            if name in place:
                picked[:, column] = self.values[:, place[name]]
        return picked


class RowReader(Protocol):
    """Decodes the messages of one topic into rows."""

    def newest(self, data: bytes) -> Row | None:
        """Return the last point of a message, None if it has none.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        ...


class NamedRows:
    """Of a message that comes as named numbers."""

    def __init__(self, builder: SeriesBuilder) -> None:
        self._builder = builder

    def newest(self, data: bytes) -> Row | None:
        """Return its last point."""
        names, stamps, values = self._builder.read(data)
        return Row(stamps[-1], names, values[-1]) if stamps else None


class BaseRows:
    """Of the odometry of a base without legs, with the names that /state gives to a base.

    The position is that of its disc's centre, which may be ahead of its axle.
    """

    def __init__(self, robot: str, frame: str, ahead: float) -> None:
        self._names = tuple(f'{robot}/{entry}' for entry in BASE_NAMES)
        self._reader, self._ahead = OdometryReader(robot, frame), ahead

    def newest(self, data: bytes) -> Row | None:
        """Return its pose, and its twist in the frame of the base."""
        base = self._reader.read(data)
        c, s = math.cos(base.yaw), math.sin(base.yaw)
        (x, y), (vx, vy) = base.position.tolist(), base.velocity.tolist()
        pose = (x + self._ahead * c, y + self._ahead * s, 0.0, 0.0, 0.0)
        half = 0.5 * base.yaw
        sideways = c * vy - s * vx + self._ahead * base.yaw_rate
        twist = (c * vx + s * vy, sideways, 0.0, 0.0, 0.0, base.yaw_rate, 0.0)
        values = np.array([(*pose, math.sin(half), math.cos(half)), twist, (0.0,) * len(twist)])
        return Row(base.stamp_ns, self._names, values)


def row_readers(scenario: Scenario) -> dict[str, RowReader]:
    """Return a reader for every topic of a run that comes as numbers."""
    readers: dict[str, RowReader] = {
        PLAN: NamedRows(PlannedMotions()),
        CLEARANCE: NamedRows(JointStates()),
        BALLS: NamedRows(JointStates()),
        **{t: NamedRows(JointTrajectories()) for t in (BARRIERS, INTERVENTION, DESIRED, COMMANDS)},
    }
    frame, offsets = shared_frame(scenario), disc_offsets(scenario)
    for robot in scenario.robots:
        if robot.kind == LEGGED:
            readers[STATE] = NamedRows(JointStates())
            readers[forces_topic(robot.name)] = NamedRows(JointStates())
        else:
            readers[odometry(robot.name)] = BaseRows(robot.name, frame, offsets[robot.name])
    return readers


def state_topic(robot: Robot) -> str:
    """Return where it is told how a robot moves."""
    return STATE if robot.kind == LEGGED else odometry(robot.name)


def forces_topic(robot: str) -> str:
    """Return where a robot's planned ground reaction forces are told."""
    return f'/{robot}/ground_forces'


def planned_motion(row: Row | None, robot: str) -> PlannedMotion | None:
    """Return the safe motion of a robot out of a row of PLAN, None if it isn't there."""
    if row is None or robot not in row.names:
        return None
    values = row.values[:, row.names.index(robot)]
    transform, velocity, acceleration = values[:7], values[7:13], values[13:]
    if not np.isfinite(values[:9]).all():
        return None
    return PlannedMotion(
        row.stamp_ns,
        transform[:2],
        velocity[:2],
        np.nan_to_num(acceleration[:2]),
        2.0 * math.atan2(transform[5], transform[6]),
        float(velocity[5]),
        float(transform[2]),
        float(velocity[2]),
    )
