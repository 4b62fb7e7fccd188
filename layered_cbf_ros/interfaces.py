"""The few small types that pass between the layers.

Joints are ordered FL, FR, RL, RR, each hip, upper, lower: pinocchio's order for
the A1. Feet are ordered FL, FR, RL, RR. The world frame is REP-103: x forward,
y left, z up. Quaternions are (x, y, z, w).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEGS = ('FL', 'FR', 'RL', 'RR')
JOINT_NAMES = tuple(f'{leg}_{joint}_joint' for leg in LEGS for joint in ('hip', 'upper', 'lower'))
NS_PER_S = 1_000_000_000

GRAVITY = 9.81
"""Acceleration of gravity [m/s^2]."""

TOE_RADIUS = 0.02
"""Radius of the sphere at the end of each leg [m]."""


@dataclass(frozen=True, slots=True)
class RobotState:
    """Measured state of one quadruped.

    Attributes:
        stamp_ns: Time of the measurement [ns].
        configuration: Base position in the world [m] (3), base orientation
            quaternion x, y, z, w (4), joint angles [rad] (12); shape (19,).
        velocity: Base linear and angular velocity in the base frame [m/s],
            [rad/s] (6), joint velocities [rad/s] (12); shape (18,).
        torques: Joint torques that acted up to the stamp [Nm], (12,).
        foot_forces: Normal force on each foot [N], (4,).
    """

    stamp_ns: int
    configuration: Array
    velocity: Array
    torques: Array
    foot_forces: Array


@dataclass(frozen=True, slots=True)
class Measured:
    """What the sensors of one quadruped read: it cannot see where it is.

    Attributes:
        stamp_ns: Time of the measurement [ns].
        joints: Joint angles [rad], joint velocities [rad/s] and torques [Nm], (3, 12).
        orientation: Of the IMU, quaternion x, y, z, w, (4,); its yaw begins anywhere.
        angular_velocity: Base frame [rad/s], (3,).
        specific_force: Acceleration minus gravity, base frame [m/s^2], (3,).
        foot_forces: Of each foot, in the sensor's unit, (4,).
    """

    stamp_ns: int
    joints: Array
    orientation: Array
    angular_velocity: Array
    specific_force: Array
    foot_forces: Array


@dataclass(frozen=True, slots=True)
class BaseState:
    """Measured motion in the plane of a robot that has its own locomotion.

    Attributes:
        stamp_ns: Time of the measurement [ns].
        position: Of its centre in the world [m], (2,).
        velocity: Of this point in the world [m/s], (2,).
        yaw: Heading [rad].
        yaw_rate: Its rate [rad/s].
    """

    stamp_ns: int
    position: Array
    velocity: Array
    yaw: float
    yaw_rate: float

    def at(self, stamp_ns: int) -> BaseState:
        """Return the motion a little later, at the same velocities."""
        dt = (stamp_ns - self.stamp_ns) / NS_PER_S
        place, yaw = self.position + dt * self.velocity, self.yaw + dt * self.yaw_rate
        return BaseState(stamp_ns, place, self.velocity, yaw, self.yaw_rate)

    def ahead(self, length: float) -> BaseState:
        """Return the motion of a point of the base ahead of its centre by a length [m]."""
        forward = np.array([math.cos(self.yaw), math.sin(self.yaw)])
        left = np.array([-forward[1], forward[0]])
        return BaseState(
            self.stamp_ns,
            self.position + length * forward,
            self.velocity + length * self.yaw_rate * left,
            self.yaw,
            self.yaw_rate,
        )


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """What the coordinator lets one robot do: one point of its safe trajectory.

    Attributes:
        stamp_ns: Time of the point [ns].
        position: Planned CoM position in the world plane [m], (2,).
        velocity: Its velocity [m/s], (2,).
        acceleration: Its acceleration [m/s^2], (2,).
        yaw: Planned heading [rad].
        yaw_rate: Its rate [rad/s].
        height: Planned height of the CoM relative to where it is when the robot
            stands [m]: 0 to stand or walk, negative to sit down.
        vertical_velocity: Its rate [m/s].
    """

    stamp_ns: int
    position: Array
    velocity: Array
    acceleration: Array
    yaw: float
    yaw_rate: float
    height: float = 0.0
    vertical_velocity: float = 0.0

    @classmethod
    def standing(cls, stamp_ns: int, position: Array, yaw: float) -> PlannedMotion:
        """Return the motion of a robot that stands still."""
        return cls(stamp_ns, np.array(position), np.zeros(2), np.zeros(2), yaw, 0.0)

    def at(self, stamp_ns: int) -> PlannedMotion:
        """Return the motion a little later, the acceleration held constant."""
        dt = (stamp_ns - self.stamp_ns) / NS_PER_S
        return PlannedMotion(
            stamp_ns,
            self.position + dt * self.velocity + 0.5 * dt * dt * self.acceleration,
            self.velocity + dt * self.acceleration,
            self.acceleration,
            self.yaw + dt * self.yaw_rate,
            self.yaw_rate,
            self.height + dt * self.vertical_velocity,
            self.vertical_velocity,
        )

    def braked(self, stamp_ns: int, deceleration: float) -> PlannedMotion:
        """Return where the robot is at a stamp if it brakes from now on.

        Args:
            stamp_ns: Time asked for, not before this motion's stamp [ns].
            deceleration: Size of the braking acceleration [m/s^2].

        Returns:
            The motion on a straight stopping path; yaw and height hold at once.
        """
        dt = (stamp_ns - self.stamp_ns) / NS_PER_S
        speed = float(np.hypot(*self.velocity))
        if speed < 1e-9:
            still = PlannedMotion.standing(stamp_ns, self.position, self.yaw)
            return replace(still, height=self.height)
        heading = self.velocity / speed
        t = min(dt, speed / deceleration)
        moving = dt < speed / deceleration
        return PlannedMotion(
            stamp_ns,
            self.position + heading * (speed * t - 0.5 * deceleration * t * t),
            heading * (speed - deceleration * t),
            -deceleration * heading if moving else np.zeros(2),
            self.yaw,
            0.0,
            self.height,
        )


@dataclass(frozen=True, slots=True)
class GroundForcePlan:
    """What the MPC asks of the feet, and what it predicts for the body.

    Attributes:
        stamp_ns: Stamp of the state it was computed from [ns].
        forces: Ground reaction forces in the world [N], (4, 3); zero in swing.
        footholds: Where each foot stands, or will touch down next, centre of the
            toe sphere in the world [m], (4, 3).
        swing_phase: Done part of each foot's swing in [0, 1), (4,); 0 in stance.
        swing_rate: Its rate [1/s], (4,); exactly 0 tells that a foot is in stance.
        predicted: Predicted next state eta = CoM position [m], CoM velocity [m/s],
            both in the world, rotation vector from the present orientation [rad],
            angular velocity in the base frame [rad/s]; shape (12,).
    """

    stamp_ns: int
    forces: Array
    footholds: Array
    swing_phase: Array
    swing_rate: Array
    predicted: Array

    @property
    def in_stance(self) -> NDArray[np.bool_]:
        """Tell which feet carry the robot, (4,)."""
        return self.swing_rate == 0.0


@dataclass(frozen=True, slots=True)
class Track:
    """What is known of one obstacle, or of any body that isn't one of our agents.

    Attributes:
        name: Stable name of the track.
        stamp_ns: Time the estimate is for [ns].
        position: Centre in the world plane [m], (2,).
        velocity: Its velocity [m/s], (2,).
        covariance: Of position and velocity, (4, 4).
        radius: Radius of its body [m]; 0 from the tracker, which doesn't see it.
    """

    name: str
    stamp_ns: int
    position: Array
    velocity: Array
    covariance: Array
    radius: float


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """A velocity asked for from outside.

    Attributes:
        x, y: Velocity forward and to the left [m/s].
        yaw_rate: Turning rate [rad/s].
        leader: Index of the robot whose heading "forward" means; None: the robot's own.
    """

    x: float
    y: float
    yaw_rate: float = 0.0
    leader: int | None = None

    def is_finite(self) -> bool:
        """Tell whether every number is finite."""
        return math.isfinite(self.x + self.y + self.yaw_rate)
