"""The motors of an emulated A1: what they make of a command, and how warm they get."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.plants.a1.frames import MOTOR_OFF, OVERHEATED, SERVO, LowCommand
from layered_cbf_ros.plants.a1.packets import POSITION_OFF, VELOCITY_OFF

BRAKE = 1.0
"""Damping of a motor that is off, its windings shorted [Nm s/rad]; a guess."""

HEATING, COOLING_TIME, HOTTEST = 0.004, 100.0, 90.0
"""Warming per squared torque [degC/(s Nm^2)], time constant of the way back [s], and the
temperature at which a motor protects itself [degC]: a sustained 24 Nm does that within a
minute, which is about what was told of real ones."""


def joint_torques(command: LowCommand | None, position: Array, velocity: Array) -> Array:
    """Return tau + kp (q_des - q) + kd (dq_des - dq), or the brake of motors that are off.

    Args:
        command: What is in force; None: the motors are off.
        position, velocity: Of the joints [rad], [rad/s], (12,).
    """
    if command is None or command.mode != SERVO:
        return -BRAKE * velocity
    has_position = np.abs(command.position) < 0.5 * POSITION_OFF
    has_velocity = np.abs(command.velocity) < 0.5 * VELOCITY_OFF
    stiffness = np.where(has_position, command.kp * (command.position - position), 0.0)
    damping = np.where(has_velocity, command.kd * (command.velocity - velocity), 0.0)
    torques: Array = command.torque + stiffness + damping
    return torques


@dataclass(frozen=True, slots=True)
class Motors:
    """Temperature of each motor [degC], (12,), and that of the air around them."""

    temperature: Array
    ambient: float

    @classmethod
    def cold(cls, ambient: float) -> Motors:
        """Return motors as warm as the air."""
        return cls(np.full(12, ambient), ambient)

    def after(self, torques: Array, dt: float) -> Motors:
        """Return them after a while [s] at these torques [Nm], (12,)."""
        excess = self.temperature - self.ambient
        rate = HEATING * torques * torques - excess / COOLING_TIME
        return Motors(self.temperature + dt * rate, self.ambient)

    def limited(self, torques: Array, velocity: Array, limit: float) -> Array:
        """Return torques within the limit [Nm]; who is too hot only brakes."""
        hot = self.temperature > HOTTEST
        limited: Array = np.where(hot, -BRAKE * velocity, np.clip(torques, -limit, limit))
        return limited

    def modes(self, command: LowCommand | None) -> Array:
        """Return the mode that each motor tells, (12,)."""
        mode = MOTOR_OFF if command is None else command.mode
        return np.where(self.temperature > HOTTEST, OVERHEATED, mode)
