"""The sensors of an emulated A1: the truth with all that a scenario lets them get wrong."""

from __future__ import annotations

import math

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array, Measured, RobotState
from layered_cbf_ros.plants.bullet_world import ImuReading
from layered_cbf_ros.scenario_emulation import Emulation


class Sensors:
    """Reads one robot; biases are drawn once, noise anew at every reading."""

    def __init__(self, emulation: Emulation, rng: np.random.Generator) -> None:
        """Draw the biases.

        Args:
            emulation: Sizes of the errors.
            rng: Of this robot's sensors alone.
        """
        e = self._e = emulation
        self._rng = rng
        self._gyro_bias = e.gyro_bias * _direction(rng, 3)
        self._accelerometer_bias = e.accelerometer_bias * _direction(rng, 3)
        self._tilt = np.array([*(e.tilt_bias * _direction(rng, 2)), 0.0])
        self._yaw, self._drift = rng.uniform(-math.pi, math.pi), rng.choice((-1.0, 1.0))
        self._foot_offset = rng.uniform(-e.foot_force_offset, e.foot_force_offset, 4)
        self._foot_drift = rng.uniform(-e.foot_force_drift, e.foot_force_drift, 4)

    def read(self, state: RobotState, imu: ImuReading) -> Measured:
        """Return what the sensors tell of the truth.

        Args:
            state: True state.
            imu: What a perfect IMU would read.
        """
        e, rng, seconds = self._e, self._rng, state.stamp_ns / NS_PER_S
        noise = rng.standard_normal(34)
        joints = np.array((state.configuration[7:], state.velocity[6:], state.torques))
        joints[0] += e.encoder_noise * noise[:12]
        joints[1] += e.encoder_velocity_noise * noise[12:24]
        turning = imu.angular_velocity + self._gyro_bias + e.gyro_noise * noise[24:27]
        force = imu.specific_force + self._accelerometer_bias
        feet = self._foot_offset + self._foot_drift * seconds
        return Measured(
            state.stamp_ns,
            joints,
            self._orientation(imu.orientation, seconds),
            turning,
            force + e.accelerometer_noise * noise[27:30],
            e.foot_force_scale * state.foot_forces + feet + e.foot_force_noise * noise[30:34],
        )

    def _orientation(self, true: Array, seconds: float) -> Array:
        """Return Rz(yaw error) R_true R(tilt error) as a quaternion."""
        yaw = self._yaw + self._drift * self._e.yaw_drift * seconds
        turn = np.array((0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))
        tilt = np.array((*(0.5 * self._tilt), 1.0))
        read = product(product(turn, true), tilt)
        return read / np.linalg.norm(read)


def product(p: Array, q: Array) -> Array:
    """Return the quaternion p q: first the rotation q, then p; x, y, z, w."""
    px, py, pz, pw = p.tolist()
    qx, qy, qz, qw = q.tolist()
    return np.array((
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    ))  # fmt: skip


def _direction(rng: np.random.Generator, size: int) -> Array:
    """Return a random unit vector."""
    vector = rng.standard_normal(size)
    unit: Array = vector / np.linalg.norm(vector)
    return unit
