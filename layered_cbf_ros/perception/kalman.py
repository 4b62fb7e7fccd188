"""Kalman filter of a point that moves at nearly constant velocity in the plane.

State x = (position, velocity) in the world [m], [m/s], driven by white
acceleration of density a^2 [m^2/s^3] on each axis; measured is the position.
"""

from __future__ import annotations

import numpy as np

from layered_cbf_ros.interfaces import Array


def predict(mean: Array, covariance: Array, dt: float, acceleration: float) -> tuple[Array, Array]:
    """Return mean (4,) and covariance (4, 4) a time dt later.

    x' = F x, P' = F P F^T + a^2 [[dt^3/3, dt^2/2], [dt^2/2, dt]] (per axis).

    Args:
        mean: Estimate now, (4,).
        covariance: Its covariance, (4, 4).
        dt: Time to go on by, not negative [s].
        acceleration: Square root a of the density [m/s^2 sqrt(s)].
    """
    transition = np.eye(4)
    transition[0, 2] = transition[1, 3] = dt
    drift = np.zeros((4, 4))
    for axis in (0, 1):
        drift[axis, axis] = dt**3 / 3.0
        drift[axis, axis + 2] = drift[axis + 2, axis] = dt**2 / 2.0
        drift[axis + 2, axis + 2] = dt
    return transition @ mean, transition @ covariance @ transition.T + acceleration**2 * drift


def innovation(
    mean: Array, covariance: Array, positions: Array, noise: float
) -> tuple[Array, Array]:
    """Return how far measurements (K, 2) lie from the estimate, and how far they may.

    Args:
        mean: Estimate at the time of the measurements, (4,).
        covariance: Its covariance, (4, 4).
        positions: Measured positions [m], (K, 2).
        noise: Standard deviation of a measured coordinate [m].

    Returns:
        Innovations z - H x [m], (K, 2), and their covariance H P H^T + R, (2, 2).
    """
    return positions - mean[:2], covariance[:2, :2] + noise**2 * np.eye(2)


def update(mean: Array, covariance: Array, position: Array, noise: float) -> tuple[Array, Array]:
    """Return mean and covariance after a measured position (2,) [m].

    K = P H^T S^-1, x' = x + K (z - H x), and P' in Joseph's form
    (1 - K H) P (1 - K H)^T + K R K^T, which stays symmetric and positive.
    """
    error, spread = innovation(mean, covariance, position, noise)
    gain = np.linalg.solve(spread, covariance[:2]).T
    left = np.eye(4)
    left[:, :2] -= gain
    return mean + gain @ error, left @ covariance @ left.T + noise**2 * gain @ gain.T
