"""Virtual constraints: what the controlled outputs should do, paper eq. (25)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from layered_cbf_ros.interfaces import Array, PlannedMotion
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters


@dataclass(frozen=True, slots=True)
class BodyReference:
    """Desired motion of the body, in the world.

    Attributes:
        com, com_velocity, com_acceleration: Of the CoM [m], [m/s], [m/s^2], (3,).
        rotation: Base frame to world, (3, 3).
        angular_velocity, angular_acceleration: [rad/s], [rad/s^2], (3,).
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    rotation: Array
    angular_velocity: Array
    angular_acceleration: Array


@dataclass(frozen=True, slots=True)
class FeetReference:
    """Desired motion of the toes, in the world.

    Attributes:
        swinging: 1.0 for each foot in swing, 0.0 in stance, (4,).
        position, velocity, acceleration: Of the toe centres [m], [m/s], [m/s^2],
            (4, 3); without meaning in stance.
    """

    swinging: Array
    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, slots=True)
class OutputDynamics:
    """The outputs y and the second derivatives that make them vanish.

    Rows: CoM in the world (3), orientation in the base frame (3), the toes in
    the world one after the other (12).

    Attributes:
        error: y, zero for stance feet, [m] and [rad], (18,).
        acceleration: Desired second derivative of each controlled quantity
            theta_0, zero for stance feet, [m/s^2] and [rad/s^2], (18,).
    """

    error: Array
    acceleration: Array


def level_body(motion: PlannedMotion, com_height: float) -> BodyReference:
    """Return a level body that follows a motion.

    Args:
        motion: In the plane, and up and down.
        com_height: Height of the CoM when the robot stands [m].
    """
    cos, sin = math.cos(motion.yaw), math.sin(motion.yaw)
    x, y = motion.position.tolist()
    vx, vy = motion.velocity.tolist()
    ax, ay = motion.acceleration.tolist()
    return BodyReference(
        np.array([x, y, com_height + motion.height]),
        np.array([vx, vy, motion.vertical_velocity]),
        np.array([ax, ay, 0.0]),
        np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]),
        np.array([0.0, 0.0, motion.yaw_rate]),
        np.zeros(3),
    )


class VirtualConstraints:
    """Output dynamics y'' + K_d y' + K_p y = 0 of the CoM, orientation and swing feet.

    The orientation error is log(R_des^T R), which is the error in Euler angles
    when it is small, and has no singularity at 90 degrees of pitch.
    """

    def __init__(self, parameters: WholeBodyParameters) -> None:
        """Take the gains."""
        self._body_gains = parameters.body_stiffness, parameters.body_damping
        self._swing_gains = parameters.swing_stiffness, parameters.swing_damping

    def outputs(
        self, model: RobotModel, velocity: Array, body: BodyReference, feet: FeetReference
    ) -> OutputDynamics:
        """Return the outputs and their desired accelerations.

        Args:
            model: Updated to the robot's state.
            velocity: Generalized velocity as in RobotState, (18,).
            body: Desired motion of the body.
            feet: Desired motion of the toes.
        """
        error, acceleration = np.empty(18), np.empty(18)
        kp, kd = self._body_gains
        error[:3] = model.com - body.com
        rate = model.com_velocity - body.com_velocity
        acceleration[:3] = body.com_acceleration - kp * error[:3] - kd * rate
        error[3:6], acceleration[3:6] = self._orientation(model.rotation, velocity[3:6], body)
        kp, kd = self._swing_gains
        toe_velocity = (model.feet_jacobian @ velocity).reshape(4, 3)
        swinging = feet.swinging[:, None]
        toe_error = swinging * (model.feet - feet.position)
        toe_rate = swinging * (toe_velocity - feet.velocity)
        error[6:] = toe_error.ravel()
        toes = swinging * feet.acceleration - kp * toe_error - kd * toe_rate
        acceleration[6:] = toes.ravel()
        return OutputDynamics(error, acceleration)

    def _orientation(
        self, rotation: Array, angular_velocity: Array, body: BodyReference
    ) -> tuple[Array, Array]:
        """Return the orientation error [rad] and the desired w' [rad/s^2], base frame.

        The desired angular velocity seen from the turning base, R^T w_des, changes
        at R^T w_des' - w x R^T w_des: the feed-forward.
        """
        kp, kd = self._body_gains
        error = pin.log3(body.rotation.T @ rotation)
        desired = rotation.T @ body.angular_velocity
        rate = angular_velocity - desired
        forward = rotation.T @ body.angular_acceleration - _cross(angular_velocity, desired)
        return error, forward - kp * error - kd * rate


def _cross(a: Array, b: Array) -> Array:
    """Return a x b, quicker than numpy's for single vectors."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
