"""The ball that contains a region of potential collision (paper II-A, III-A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import Array


@dataclass(frozen=True, slots=True)
class CollisionBalls:
    """Balls (q, r) of M directed pairs and the barrier they give.

    Attributes:
        centre: q in the world [m], (M, 2).
        radius: r [m], (M,).
        barrier: h [m], (M,); h >= 0 implies a centre distance of at least the
            radius of ball j.
    """

    centre: Array
    radius: Array
    barrier: Array


def collision_balls(
    position: Array, direction: Array, distance: Array, reach: Array, ball: Array
) -> CollisionBalls:
    """Enclose what a point i and a ball j can both reach (paper eq. (4), (14), (15)).

    Ball i has the reach of i, ball j the reach of j plus both body radii: the sizes
    enter once, so that they can't vanish behind a large reach of i. With
    a = (d^2 + r_i^2 - r_j^2) / (2 d), the distance from i to the common chord, and
    c = sqrt(r_i^2 - a^2), half its length:

    - the balls are apart, or ball j is the smaller part of the lens (a > d):
      q = phi_j, r = r_j, h = d - r_j;
    - the chord lies between the centres: q = phi_i + a n, r = c, h = a - c;
    - ball i is the smaller part (a < 0): q = phi_i, r = r_i. Its distance to phi_i is
      0 and has no gradient, so h = d - r_j along the line of centres.

    h >= 0 implies d >= r_j. In the lens: a >= c gives r_i^2 = a^2 + c^2 <= 2 a^2 <=
    2 a d, hence r_j^2 = d^2 + r_i^2 - 2 a d <= d^2.

    Args:
        position: phi_i in the world [m], (M, 2).
        direction: Unit vector n from i to j, (M, 2).
        distance: d = |phi_j - phi_i| [m], (M,), positive.
        reach: r_i [m], (M,).
        ball: r_j [m], (M,).
    """
    chord = (distance**2 + reach**2 - ball**2) / (2.0 * distance)
    inside = chord < 0.0
    lens = ~inside & (chord <= distance) & (reach + ball > distance)
    half_chord = np.sqrt(np.maximum(reach**2 - chord**2, 0.0))
    radius = np.where(lens, half_chord, ball)
    along = np.where(lens, chord, distance)
    barrier = along - radius
    if inside.any():
        radius = np.where(inside, reach, radius)
        along = np.where(inside, 0.0, along)
    return CollisionBalls(position + along[:, None] * direction, radius, barrier)
