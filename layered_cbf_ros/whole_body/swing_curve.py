"""Way of a swing foot through the air: Bezier polynomials of the swing phase."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.polynomial import Polynomial

from layered_cbf_ros.interfaces import Array

_ADVANCE = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
"""Quintic from lift-off (0) to touchdown (1), at rest at both ends."""

_RISE = (0.0, 0.0, 0.0, 3.2, 0.0, 0.0, 0.0)
"""Sextic of height one at half phase, velocity and acceleration zero at both ends."""


def bezier(control: tuple[float, ...]) -> Polynomial:
    """Return sum_k c_k (n over k) s^k (1 - s)^(n-k) in powers of s."""
    degree = len(control) - 1
    s, rest = Polynomial([0.0, 1.0]), Polynomial([1.0, -1.0])
    return sum(
        (c * comb(degree, k) * s**k * rest ** (degree - k) for k, c in enumerate(control)),
        Polynomial([0.0]),
    )


class SwingCurve:
    """Toe positions p(s) = p0 + a(s) (p1 - p0) + r(s) step_height e_z.

    p0 is the lift-off position, p1 the foothold, s in [0, 1] the phase, a and r
    the Bezier polynomials above.
    """

    def __init__(self, step_height: float) -> None:
        """Take the rise halfway, over the line from lift-off to foothold [m]."""
        polynomials = (bezier(_ADVANCE), bezier(_RISE) * step_height)
        self._coefficients = np.zeros((6, 7))
        rows = (p.deriv(order) if order else p for p in polynomials for order in range(3))
        for row, polynomial in enumerate(rows):
            self._coefficients[row, : len(polynomial.coef)] = polynomial.coef
        self._powers = np.arange(7)[:, None]

    def at(
        self, lift_off: Array, foothold: Array, phase: Array, rate: Array
    ) -> tuple[Array, Array, Array]:
        """Return where n toes should be, and how they should move.

        Args:
            lift_off: Where each swing began, world [m], (n, 3).
            foothold: Where each swing ends, world [m], (n, 3).
            phase: Done part of each swing, in [0, 1], (n,).
            rate: Its rate [1/s], (n,).

        Returns:
            Position [m], velocity [m/s] and acceleration [m/s^2], each (n, 3);
            the foothold counts as fixed.
        """
        value = self._coefficients @ phase**self._powers
        way = foothold - lift_off
        position = lift_off + value[0][:, None] * way
        velocity = (rate * value[1])[:, None] * way
        acceleration = (rate * rate * value[2])[:, None] * way
        position[:, 2] += value[3]
        velocity[:, 2] += rate * value[4]
        acceleration[:, 2] += rate * rate * value[5]
        return position, velocity, acceleration
