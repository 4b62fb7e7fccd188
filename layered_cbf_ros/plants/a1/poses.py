"""Poses that the driver itself takes, the paths between them, and the limits of joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import JOINT_NAMES, Array
from layered_cbf_ros.robot_model import RobotModel

LOWEST = np.tile([-0.802, -1.047, -2.696], 4)
HIGHEST = np.tile([0.802, 4.188, -0.916], 4)
"""Limits of the joints [rad], (12,): the vendor's, or the URDF's where they are tighter."""


def folded_pose(thigh: float) -> Array:
    """Return the pose of a robot that sits: toes straight below the hips [rad], (12,).

    Args:
        thigh: Angle of the thighs [rad].
    """
    return np.tile([0.0, thigh, -2.0 * thigh], 4)


def standing_pose(com_height: float) -> Array:
    """Return the pose in which the layers expect the robot [rad], (12,).

    Args:
        com_height: Height of the CoM [m].
    """
    return RobotModel(com_height).nominal_configuration(np.zeros(2), 0.0, com_height)[7:].copy()


@dataclass(frozen=True, slots=True)
class PosePath:
    """Smooth motion from pose to pose, at rest in each.

    Attributes:
        poses: [rad], n + 1 of them, (12,) each.
        times: How long each part takes [s], n.
    """

    poses: tuple[Array, ...]
    times: tuple[float, ...]

    @property
    def duration(self) -> float:
        """Return how long it takes [s]."""
        return sum(self.times)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return angles [rad] and velocities [rad/s] at a time since its beginning [s].

        A part runs by s = x^2 (3 - 2 x), x its elapsed share: s' is 0 at both ends.
        """
        for begin, end, duration in zip(self.poses[:-1], self.poses[1:], self.times, strict=True):
            if time < duration:
                x = max(0.0, time / duration)
                step = end - begin
                rate = 6.0 * x * (1.0 - x) / duration
                return begin + (x * x * (3.0 - 2.0 * x)) * step, rate * step
            time -= duration
        return self.poses[-1], np.zeros(len(JOINT_NAMES))
