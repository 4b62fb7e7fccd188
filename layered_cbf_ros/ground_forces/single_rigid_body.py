"""The robot as one rigid body that its feet push: paper eq. (22) and its linearisation.

The state is charted around an operating orientation R_op (paper section III-E):
eta = col(c, v, xi, w), shape (12,), with the CoM position c [m] and velocity v
[m/s] in the world, the rotation vector xi [rad] of R = R_op exp([xi]x), and the
angular velocity w [rad/s] in the base frame. Forces are in the world, one a foot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import GRAVITY, Array

# [a]x = sum_i a_i SKEW_BASIS[i], so that one product makes the matrices of many vectors.
SKEW_BASIS = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1] + 5 * [0]],
    dtype=np.float64,
)


@dataclass(frozen=True)
class RigidBody:
    """What the middle layer knows of a robot.

    Attributes:
        mass: Mass of the whole robot [kg].
        inertia: Inertia about its CoM in a nominal stance, base frame [kg m^2], (3, 3).
        hip_offsets: Where each foot stands in a nominal stance, base frame, from any
            fixed point [m], (4, 3): the gait puts the CoM above their mean.
    """

    mass: float
    inertia: Array
    hip_offsets: Array


@dataclass(frozen=True)
class AffineModel:
    """eta' = state @ eta + force @ f + offset, or the same for one step in time.

    Attributes:
        state: (12, 12).
        force: (12, 3 feet), the columns x, y, z of one foot after the other.
        offset: (12,).
    """

    state: Array
    force: Array
    offset: Array

    def after(self, eta: Array, forces: Array) -> Array:
        """Return the value at a state (12,) and forces (feet, 3) [N]; shape (12,)."""
        return self.state @ eta + self.force @ forces.ravel() + self.offset


def skew(vectors: Array) -> Array:
    """Return the matrices [a]x with [a]x b = a x b; (..., 3) to (..., 3, 3)."""
    return (vectors @ SKEW_BASIS).reshape(*vectors.shape, 3)


def exp_rotation(vector: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    angle = math.sqrt(vector @ vector)
    a = math.sin(angle) / angle if angle > 1e-8 else 1.0
    b = 0.5 * (math.sin(0.5 * angle) / (0.5 * angle)) ** 2 if angle > 1e-8 else 0.5
    cross = skew(vector)
    return np.eye(3) + a * cross + b * (cross @ cross)


def log_rotation(rotation: Array) -> Array:
    """Return the rotation vector (3,) [rad] of a rotation matrix (3, 3), angle <= pi.

    It goes through the quaternion, which stays exact at 0 and at pi.
    """
    m = rotation.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0.0:
        w = 1.0 + trace
        x, y, z = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
    else:
        i = max(range(3), key=lambda k: m[k][k])
        j, k = (i + 1) % 3, (i + 2) % 3
        w = m[k][j] - m[j][k]
        axis = [0.0, 0.0, 0.0]
        axis[i] = 1.0 + m[i][i] - m[j][j] - m[k][k]
        axis[j], axis[k] = m[j][i] + m[i][j], m[k][i] + m[i][k]
        x, y, z = axis if w >= 0.0 else (-a for a in axis)
        w = abs(w)
    length = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(length, w) / length if length > 1e-12 else 2.0 / w
    return np.array((scale * x, scale * y, scale * z))


def derivative(
    body: RigidBody, operating_rotation: Array, eta: Array, feet: Array, forces: Array
) -> Array:
    """Return d(eta)/dt of the nonlinear body, paper eq. (22), in the chart of R_op.

    c' = v,  v' = sum f / m - g,  xi' = J(xi) w,
    w' = I^-1 (R^T sum (p - c) x f - w x I w),
    with J the inverse right Jacobian of SO(3), which makes R' = R [w]x.

    Args:
        body: The robot.
        operating_rotation: R_op, base to world, (3, 3).
        eta: State, (12,).
        feet: Where the forces act, world [m], (feet, 3).
        forces: Ground reaction forces, world [N], (feet, 3).

    Returns:
        The derivative, (12,).
    """
    velocity, xi, omega = eta[3:6], eta[6:9], eta[9:12]
    rotation = operating_rotation @ exp_rotation(xi)
    torque = rotation.T @ np.cross(feet - eta[0:3], forces).sum(axis=0)
    momentum = body.inertia @ omega
    acceleration = forces.sum(axis=0) / body.mass - np.array([0.0, 0.0, GRAVITY])
    half = 0.5 * math.sqrt(xi @ xi)
    curvature = (1.0 - half / math.tan(half)) / (4.0 * half * half) if half > 1e-4 else 1.0 / 12.0
    cross = skew(xi)
    xi_rate = omega + 0.5 * cross @ omega + curvature * cross @ cross @ omega
    omega_rate = np.linalg.solve(body.inertia, torque - np.cross(omega, momentum))
    return np.concatenate((velocity, acceleration, xi_rate, omega_rate))


class SingleRigidBody:
    """Linear models of one robot, for the MPC's hot path.

    Args:
        body: The robot.
        feet: How many feet may push.
    """

    def __init__(self, body: RigidBody, feet: int) -> None:
        self._inertia = body.inertia
        self._inverse_inertia = np.linalg.inv(body.inertia)
        self._state = np.zeros((12, 12))
        self._state[0:3, 3:6] = self._state[6:9, 9:12] = np.eye(3)
        self._force = np.zeros((12, 3 * feet))
        self._force[3:6] = np.tile(np.eye(3) / body.mass, feet)
        self._offset = np.zeros(12)
        self._offset[5] = -GRAVITY

    def linearise(self, rotation: Array, eta: Array, feet: Array, forces: Array) -> AffineModel:
        """Linearise the body about (eta, forces), at xi = 0 and R_op = rotation.

        With F = sum f, tau = R^T sum (p - c) x f, the rows that are not trivial are
        xi' = w - [w_op]x xi / 2 and the first-order terms of w':
        d/dc: I^-1 R^T [F]x,   d/dxi: I^-1 [tau]x,   d/dw: I^-1 ([I w]x - [w]x I),
        d/df: I^-1 R^T [p - c]x   (paper section III-E, matrices at "op").

        Args:
            rotation: Present orientation, base to world, (3, 3).
            eta: Present state with xi = 0, (12,).
            feet: Where the forces act, world [m], (feet, 3).
            forces: Operating forces, world [N], (feet, 3).

        Returns:
            The model, continuous in time.
        """
        omega = eta[9:12]
        momentum = self._inertia @ omega
        levers = skew(feet - eta[0:3]).transpose(1, 0, 2).reshape(3, -1)
        turning = rotation.T @ levers
        torque = turning @ forces.ravel()
        vectors = np.empty((4, 3))
        vectors[0] = forces.sum(axis=0)
        vectors[1] = torque
        vectors[2] = momentum
        vectors[3] = omega
        total_cross, torque_cross, momentum_cross, omega_cross = skew(vectors)

        state, force, offset = self._state.copy(), self._force.copy(), self._offset.copy()
        state[6:9, 6:9] = -0.5 * omega_cross
        angular = np.zeros((3, 12))
        angular[:, 0:3] = rotation.T @ total_cross
        angular[:, 6:9] = torque_cross
        angular[:, 9:12] = momentum_cross - omega_cross @ self._inertia
        state[9:12] = self._inverse_inertia @ angular
        force[9:12] = self._inverse_inertia @ turning
        offset[9:12] = -self._inverse_inertia @ (omega_cross @ momentum + angular @ eta)
        return AffineModel(state, force, offset)


def discretise(model: AffineModel, dt: float) -> AffineModel:
    """Return the model over one step, eta(t + dt) = C eta + D f + eps (paper section III-E).

    The series is cut after dt^2, so a constant force on the CoM is exact:
    C = I + dt A + dt^2 A^2 / 2,  (D, eps) = (dt I + dt^2 A / 2) (B, b).

    Args:
        model: The model, continuous in time.
        dt: The step [s].
    """
    average = (0.5 * dt * dt) * model.state
    average.ravel()[::13] += dt
    state = average @ model.state
    state.ravel()[::13] += 1.0
    return AffineModel(state, average @ model.force, average @ model.offset)
