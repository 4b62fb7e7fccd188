"""What joints and gyroscope tell of the feet, and so of the body above them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import Array, Measured
from layered_cbf_ros.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class LegMotion:
    """How the feet move seen from the base, in directions of the world.

    A toe is a sphere that rolls on the ground: its centre goes on while the point that
    touches the ground rests. Taken for resting, the centre would tell a velocity that is
    wrong by the sphere's radius times the turning rate of the lower leg, and the robot would
    be lost by 7 % of its way.

    Attributes:
        feet: Centres of the toes [m], (4, 3).
        contact_velocity: Velocities of the points where toes would touch level ground,
            with the turning of the base, without its velocity [m/s], (4, 3).
        rolling: Velocities of the centres against these points [m/s], (4, 3).
    """

    feet: Array
    contact_velocity: Array
    rolling: Array

    @property
    def height(self) -> float:
        """Return how high the base is above the centres of the toes, on average [m]."""
        return -float(self.feet[:, 2].mean())

    @property
    def speed(self) -> float:
        """Return the speed of the base if all feet stand [m/s]."""
        return float(np.linalg.norm(self.contact_velocity.mean(axis=0)))


class LegOdometry:
    """Forward kinematics of the four legs; its only memory is their workspace."""

    def __init__(self) -> None:
        """Make the model."""
        self._model = RobotModel()
        self._configuration, self._velocity = np.zeros(19), np.zeros(18)

    def look(self, measured: Measured, orientation: Array, angular_velocity: Array) -> LegMotion:
        """Return how the feet move.

        Args:
            measured: Joint angles and velocities.
            orientation: Of the base in the world, quaternion x, y, z, w, (4,).
            angular_velocity: Base frame [rad/s], (3,).
        """
        self._configuration[3:7], self._configuration[7:] = orientation, measured.joints[0]
        self._velocity[3:6], self._velocity[6:] = angular_velocity, measured.joints[1]
        centre, contact = self._model.toe_velocities(self._configuration, self._velocity)
        return LegMotion(self._model.feet.copy(), contact, centre - contact)

    def centre_of_mass(self, measured: Measured, orientation: Array) -> Array:
        """Return the CoM seen from the base, in directions of the world [m], (3,)."""
        self._configuration[3:7], self._configuration[7:] = orientation, measured.joints[0]
        self._model.update_kinematics(self._configuration, np.zeros(18))
        return self._model.com.copy()
