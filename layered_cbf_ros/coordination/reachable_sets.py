"""Forward reachable sets, projected onto the line of approach (paper eq. (13)).

Each function returns how far a body may get from where it is, measured along a
unit direction: max |direction . (phi(tau) - phi(0))| over tau in [0, horizon].
"""

from __future__ import annotations

import math

import numpy as np

from layered_cbf_ros.interfaces import Array


def agent_reach(
    direction: Array, velocity: Array, target: Array, horizon: float, gain: float, limit: float
) -> Array:
    """Return the reach of agents whose law is known (paper eq. (11)).

    The law is u = gain (target - v), its norm clipped to limit, the target velocity
    held over the horizon. On the way to a goal the target fades, so that holding it
    bounds every path that doesn't turn round (and the others to about 15 mm).

    The velocity error w = v - target then keeps its direction; its size s falls from
    |w| linearly down to limit / gain and exponentially from there, so that the
    displacement is target tau + w/|w| S(tau) with S the integral of s. Because s is
    monotonic, the projection has at most one extremum inside the horizon: where
    direction . target = -s direction . w/|w|.

    Args:
        direction: Unit vectors in the world, (M, 2).
        velocity: Present velocities in the world [m/s], (M, 2).
        target: Desired velocities in the world [m/s], (M, 2).
        horizon: Time that is looked ahead [s].
        gain: Velocity gain beta_2 [1/s].
        limit: Largest acceleration of the law [m/s^2].

    Returns:
        Reach [m], (M,).
    """
    error = velocity - target
    size = np.maximum(np.hypot(error[:, 0], error[:, 1]), 1e-9)
    along_error = np.einsum('ij,ij->i', direction, error) / size
    along_target = np.einsum('ij,ij->i', direction, target)
    knee = np.minimum(size, limit / gain)  # from here on the decay is exponential
    knee_time = (size - knee) / limit
    late = np.maximum(horizon - knee_time, 0.0)
    size_end = (size - limit * np.minimum(knee_time, horizon)) * np.exp(-gain * late)

    steep = np.where(np.abs(along_error) < 1e-12, 1e-12, along_error)
    size_turn = np.minimum(np.maximum(-along_target / steep, size_end), size)
    sizes = np.array([size_end, size_turn])
    early, late_size = np.maximum(sizes, knee), np.minimum(sizes, knee)
    time = (size - early) / limit + np.log(knee / late_size) / gain
    travel = (size**2 - early**2) / (2.0 * limit) + (knee - late_size) / gain
    reach: Array = np.abs(along_target * time + along_error * travel).max(axis=0)
    return reach


def obstacle_reach(direction: Array, velocity: Array, horizon: Array | float) -> Array:
    """Return the reach of bodies of which only the state is known (paper eq. (12)).

    The paper lets the velocity range over -v0 <= zeta <= v0, which is empty for a
    negative component; it is read as |zeta_x| <= |v0_x| and |zeta_y| <= |v0_y|.
    The farthest projection is horizon (|v0_x| |n_x| + |v0_y| |n_y|).

    Args:
        direction: Unit vectors n in the world, (M, 2).
        velocity: Present velocities v0 in the world [m/s], (M, 2).
        horizon: Time that is looked ahead [s], one for all or (M,).

    Returns:
        Reach [m], (M,).
    """
    reach: Array = horizon * np.abs(direction * velocity).sum(axis=1)
    return reach


def unseen_growth(
    age: float, horizon: float, acceleration: float, covariance: Array, confidence: float
) -> float:
    """Return by how much an obstacle's set widens for what its track can't tell.

    Since the estimate the velocity may have changed by acceleration * age, which
    carries acceleration * age (age / 2 + horizon) far. Errors of the estimate carry
    confidence (sigma_position + (age + horizon) sigma_velocity) far; the largest
    eigenvalue of a 2x2 covariance is at most max(diagonal) + |off-diagonal|.

    Args:
        age: Time since the estimate [s].
        horizon: Time that is looked ahead from now [s].
        acceleration: Bound on what the obstacle does unseen [m/s^2].
        covariance: Of position and velocity in the world, (4, 4).
        confidence: Number of standard deviations.

    Returns:
        Growth of the reach in every direction [m].
    """
    (xx, xy), (_, yy) = covariance[:2, :2].tolist()
    (uu, uv), (_, vv) = covariance[2:, 2:].tolist()
    position = math.sqrt(max(xx, yy, 0.0) + abs(xy))
    velocity = math.sqrt(max(uu, vv, 0.0) + abs(uv))
    drift = acceleration * age * (0.5 * age + horizon)
    return drift + confidence * (position + (age + horizon) * velocity)
