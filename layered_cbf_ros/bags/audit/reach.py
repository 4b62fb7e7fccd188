"""How far a robot under the known law may get, by stepping through the law itself."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import Array

STEP = 0.005
"""Longest step of the classical Runge-Kutta method [s]."""

ACCURACY = 1e-5
"""Error of a reach computed here [m].

Of fourth order but for the step in which the input leaves its limit; there it is of
second. Beside the closed form it stays below 2e-6 m (200 000 random motions).
"""


def agent_reaches(
    velocity: Array,
    target: Array,
    agents: NDArray[np.intp],
    directions: Array,
    law: tuple[float, float, float],
) -> Array:
    """Return the largest projection of the displacement on given directions.

    The law is v' = clip(gain (target - v)), its norm within a limit, the target held.

    Args:
        velocity, target: Of each robot at each sample, world [m/s], (k, n, 2).
        agents: Number of the robot that each direction belongs to, (m,).
        directions: Unit vectors, world, (k, m, 2).
        law: Horizon [s], gain [1/s], limit [m/s^2].

    Returns:
        max over tau in [0, horizon] of |direction . (phi(tau) - phi(0))| [m], (k, m).
    """
    horizon, gain, limit = law
    steps = max(1, math.ceil(horizon / STEP))
    dt = horizon / steps
    place, v = np.zeros_like(velocity), velocity.copy()
    largest = np.zeros(directions.shape[:2])
    along = speed = np.zeros_like(largest)
    for step in range(steps + 1):
        before, speed_before = along, speed
        along = _projected(place, agents, directions)
        speed = _projected(v, agents, directions)
        np.maximum(largest, np.abs(along), out=largest)
        if step:
            _heed_turn(largest, before, speed_before, speed, dt)
        a1 = _law(v, target, gain, limit)
        a2 = _law(v + 0.5 * dt * a1, target, gain, limit)
        a3 = _law(v + 0.5 * dt * a2, target, gain, limit)
        a4 = _law(v + dt * a3, target, gain, limit)
        place = place + dt * v + (dt * dt / 6.0) * (a1 + a2 + a3)
        v = v + (dt / 6.0) * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return largest


def box_reach(velocity: Array, directions: Array, horizon: Array | float) -> Array:
    """Return how far a body gets whose velocity keeps the size of each component [m].

    All four corners of the box |zeta_x| <= |v_x|, |zeta_y| <= |v_y| are tried.

    Args:
        velocity: World [m/s], (..., 2).
        directions: Unit vectors, world, (..., 2).
        horizon: [s], (...).
    """
    corners = [
        directions[..., 0] * (sx * velocity[..., 0]) + directions[..., 1] * (sy * velocity[..., 1])
        for sx, sy in itertools.product((-1.0, 1.0), repeat=2)
    ]
    reach: Array = np.max(corners, axis=0) * horizon
    return reach


def track_growth(covariance: Array, age: Array, run: tuple[float, float, float]) -> Array:
    """Return what a track's set is wider in every direction [m], (k,).

    Since its stamp the velocity may have changed by acceleration * age; that carries
    acceleration age^2 / 2 until now and acceleration age * horizon from now on. Errors
    of the estimate count with confidence standard deviations; each is bounded by the
    largest sum of a row of its covariance (Gershgorin).

    Args:
        covariance: xx, xy, yy of the position [m^2], then of the velocity, (k, 6).
        age: Of the track [s], (k,).
        run: Horizon [s], acceleration [m/s^2], confidence.
    """
    horizon, acceleration, confidence = run
    xx, xy, yy, uu, uv, vv = covariance.T
    position = np.sqrt(np.maximum(np.maximum(xx, yy), 0.0) + np.abs(xy))
    speed = np.sqrt(np.maximum(np.maximum(uu, vv), 0.0) + np.abs(uv))
    unseen = 0.5 * acceleration * age**2 + acceleration * age * horizon
    growth: Array = unseen + confidence * (position + speed * (age + horizon))
    return growth


def _law(v: Array, target: Array, gain: float, limit: float) -> Array:
    u = gain * (target - v)
    size = np.sqrt(u[..., 0] ** 2 + u[..., 1] ** 2)
    scale = limit / np.maximum(size, limit)
    clipped: Array = u * scale[..., None]
    return clipped


def _projected(vectors: Array, agents: NDArray[np.intp], directions: Array) -> Array:
    """Return the vector of each direction's robot along it, (k, m)."""
    own = vectors[:, agents]
    along: Array = own[..., 0] * directions[..., 0] + own[..., 1] * directions[..., 1]
    return along


def _heed_turn(largest: Array, place: Array, speed: Array, speed_after: Array, dt: float) -> None:
    """Heed an extreme between two steps: where a speed that falls linearly is zero."""
    turns = speed * speed_after < 0.0
    if turns.any():
        s0, s1 = speed[turns], speed_after[turns]
        extreme = place[turns] + 0.5 * dt * s0 * s0 / (s0 - s1)
        largest[turns] = np.maximum(largest[turns], np.abs(extreme))
