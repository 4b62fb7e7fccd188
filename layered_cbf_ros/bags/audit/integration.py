"""The planned motion carried on by its own inputs, from one stamp to a later one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import NS_PER_S, Array


def carried(
    place: Array,
    velocity: Array,
    inputs: Array,
    ticks: NDArray[np.int64],
    span: tuple[NDArray[np.intp], NDArray[np.intp]],
    rule: tuple[int, float],
) -> tuple[Array, Array]:
    """Return position [m] and velocity [m/s] after some ticks, (K, ..., 2).

    In each tick p += v dt + u dt^2 / 2, v += u dt; over missed ticks the plan coasts.

    Args:
        place, velocity: At the first of these ticks [m], [m/s], (K, ..., 2).
        inputs: Applied at each tick of the run [m/s^2], (k, ..., 2).
        ticks: Stamps of the ticks of the run [ns], (k,).
        span: Numbers of the first tick and of the one to reach, (K,) each.
        rule: Period [ns] and longest time to coast [s].
    """
    (period_ns, longest), (begin, end) = rule, span
    dt = period_ns / NS_PER_S
    p, v = place.copy(), velocity.copy()
    for step in range(int((end - begin).max(initial=0))):
        rows = np.flatnonzero(begin + step < end)
        tick = begin[rows] + step
        u = inputs[tick]
        missed = (ticks[tick + 1] - ticks[tick] - period_ns) / NS_PER_S
        coast = np.clip(missed, 0.0, longest).reshape(-1, *[1] * (p.ndim - 1))
        p[rows] += v[rows] * dt + u * (0.5 * dt * dt)
        v[rows] += u * dt
        p[rows] += v[rows] * coast
    return p, v
