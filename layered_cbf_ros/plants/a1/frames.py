"""What is told to an A1's motors, and what it tells, one frame each.

Joints and feet are in this package's order, FL, FR, RL, RR; only the packets know
the robot's own, FR, FL, RR, RL. Angles and signs are those of the URDF.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import Array

SERVO, MOTOR_OFF, OVERHEATED = 0x0A, 0x00, 0x08
"""Modes of a motor: it obeys, it is off (its windings brake it), it protects itself."""


@dataclass(frozen=True, slots=True)
class LowCommand:
    """What every motor is to do: tau + kp (position - q) + kd (velocity - dq).

    Attributes:
        mode: SERVO or MOTOR_OFF, of all motors.
        position: Desired joint angles [rad], (12,).
        velocity: Desired joint velocities [rad/s], (12,).
        torque: Feed-forward torques tau [Nm], (12,).
        kp: Stiffness of each joint [Nm/rad], (12,).
        kd: Damping of each joint [Nm s/rad], (12,).
    """

    mode: int
    position: Array
    velocity: Array
    torque: Array
    kp: Array
    kd: Array

    @classmethod
    def damping(cls, kd: float) -> LowCommand:
        """Return the command that only damps the joints, by kd [Nm s/rad]."""
        none = np.zeros(12)
        return cls(SERVO, none, none, none, none, np.full(12, kd))

    @classmethod
    def off(cls) -> LowCommand:
        """Return the command that switches the motors off."""
        none = np.zeros(12)
        return cls(MOTOR_OFF, none, none, none, none, none)


@dataclass(frozen=True, slots=True)
class LowState:
    """What an A1 tells.

    Attributes:
        tick: The robot's own clock; its unit is not known for certain.
        mode: Of each motor, (12,).
        position: Joint angles [rad], (12,).
        velocity: Joint velocities [rad/s], (12,).
        torque: Estimated joint torques [Nm], (12,).
        temperature: Of each motor [degC], (12,).
        orientation: Of the IMU, quaternion x, y, z, w, (4,); its yaw begins anywhere.
        angular_velocity: Base frame [rad/s], (3,).
        specific_force: Acceleration minus gravity, base frame [m/s^2], (3,).
        foot_force: Of each foot's air bag, in the sensor's unit, not newtons, (4,).
        remote: What the remote control sends, 40 bytes.
    """

    tick: int
    mode: NDArray[np.int64]
    position: Array
    velocity: Array
    torque: Array
    temperature: NDArray[np.int64]
    orientation: Array
    angular_velocity: Array
    specific_force: Array
    foot_force: Array
    remote: bytes
