"""The barrier of a point that moves and a ball that comes towards it, by plane geometry."""

from __future__ import annotations

import itertools

import numpy as np

from layered_cbf_ros.interfaces import Array


def barrier(distance: Array, reach: Array, ball: Array) -> Array:
    """Return h of paper eq. (14), (15) for balls of given radii at a distance [m].

    The two circles and their centres i, j span a triangle with sides d, r_i, r_j. If
    there is one, and its angles at i and at j are not obtuse, the region of both balls
    is a lens whose smallest circle has the common chord as diameter. Its centre is
    r_i cos(i) from i and its radius is r_i sin(i): h = r_i (cos(i) - sin(i)).
    In every other case the ball around j counts: h = d - r_j.

    Args:
        distance: d of the centres, (...).
        reach: r_i, (...).
        ball: r_j, the sizes of both bodies included, (...).
    """
    d, i, j = distance, np.maximum(reach, 1e-12), np.maximum(ball, 1e-12)
    cosine_i = (d * d + i * i - j * j) / (2.0 * d * i)
    cosine_j = (d * d + j * j - i * i) / (2.0 * d * j)
    lens = (i + j > d) & (cosine_i >= 0.0) & (cosine_j >= 0.0)
    sine_i = np.sqrt(np.clip(1.0 - cosine_i**2, 0.0, 1.0))
    h: Array = np.where(lens, reach * (cosine_i - sine_i), d - ball)
    return h


def enclosed_barrier(
    distance: Array, reach: Array, ball: Array, accuracy: float
) -> tuple[Array, Array]:
    """Return the least and the greatest h that radii known to an accuracy allow [m].

    Where the balls begin to touch, the half chord grows like a square root: there a
    reach that is off by 0.01 mm moves h by millimetres, and h may jump where an angle
    gets obtuse. So the published value is compared with this range, not with a number.

    Args:
        distance, reach, ball: As in `barrier`.
        accuracy: Error of each radius [m].
    """
    shifts = itertools.product((-accuracy, 0.0, accuracy), repeat=2)
    values = [barrier(distance, np.maximum(reach + a, 0.0), ball + b) for a, b in shifts]
    return np.min(values, axis=0), np.max(values, axis=0)
