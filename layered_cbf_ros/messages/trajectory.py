"""trajectory_msgs/MultiDOFJointTrajectory: the safe motion of every robot, one point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import PlannedMotion
from layered_cbf_ros.messages.cdr import (
    CdrReader,
    CdrWriter,
    FixedLayout,
    require_finite,
    stamp_of,
)

TRANSFORM, TWIST = 7, 6  # doubles in a geometry_msgs/Transform and /Twist


class TrajectoryWriter:
    """Encodes the motions of a fixed list of robots."""

    def __init__(self, robots: Sequence[str], frame_id: str = 'world') -> None:
        count = len(robots)
        writer = CdrWriter()
        writer.header(frame_id)
        writer.texts(robots)
        writer.word(1)
        for each in (TRANSFORM, TWIST, TWIST):
            writer.doubles(count, each)
        writer.word(0)
        writer.word(0)
        self._layout = FixedLayout(writer.data, writer.blocks)
        self._transforms = np.zeros((count, TRANSFORM))
        self._velocities = np.zeros((count, TWIST))
        self._accelerations = np.zeros((count, TWIST))

    def encode(self, stamp_ns: int, motions: Sequence[PlannedMotion]) -> bytes:
        """Return the message for the motions, in the order of the robots."""
        for i, motion in enumerate(motions):
            self._transforms[i, :2] = motion.position
            self._transforms[i, 2] = motion.height
            self._transforms[i, 5] = math.sin(0.5 * motion.yaw)
            self._transforms[i, 6] = math.cos(0.5 * motion.yaw)
            self._velocities[i, :2] = motion.velocity
            self._velocities[i, 2] = motion.vertical_velocity
            self._velocities[i, 5] = motion.yaw_rate
            self._accelerations[i, :2] = motion.acceleration
        return self._layout.encode(
            stamp_ns,
            self._transforms.ravel(),
            self._velocities.ravel(),
            self._accelerations.ravel(),
        )


class TrajectoryReader:
    """Picks one robot's motion out of trajectory messages, wherever it stands."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._layout: FixedLayout | None = None
        self._place = 0

    def read(self, data: bytes) -> PlannedMotion:
        """Return the first point of the robot's trajectory.

        Raises:
            MessageError: If the message is malformed, lacks the robot or isn't finite.
        """
        layout = self._layout
        if layout is None or not layout.fits(data):
            layout = self._learn(data)
        transforms, velocities, accelerations = layout.arrays(data)
        i, j = TRANSFORM * self._place, TWIST * self._place
        values = np.concatenate(
            (transforms[i : i + 7], velocities[j : j + 6], accelerations[j : j + 2])
        )
        require_finite(values, f"safe trajectory of '{self._robot}'")
        return PlannedMotion(
            stamp_of(data),
            values[:2],
            values[7:9],
            values[13:15],
            2.0 * math.atan2(values[5], values[6]),
            float(values[12]),
            float(values[2]),
            float(values[9]),
        )

    def _learn(self, data: bytes) -> FixedLayout:
        reader = CdrReader(data)
        reader.header()
        names = reader.texts()
        if self._robot not in names:
            raise MessageError(f"safe trajectory has no robot '{self._robot}'")
        if reader.word() != 1:
            raise MessageError('safe trajectory must have exactly one point')
        for what, each in (('transforms', TRANSFORM), ('velocities', TWIST), ('accelerations', 6)):
            length = len(reader.doubles(each))
            if length != each * len(names):
                raise MessageError(f'safe trajectory has {length // each} {what}')
        self._place = names.index(self._robot)
        self._layout = FixedLayout(data, reader.blocks)
        return self._layout
