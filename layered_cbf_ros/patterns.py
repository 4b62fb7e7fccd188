"""Reference motions in the plane: what obstacles follow and robots desire.

Every pattern is a pure function of time, so that a run repeats to the bit.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from layered_cbf_ros.interfaces import Array


class Pattern(Protocol):
    """A reference motion."""

    def at(self, t: float) -> tuple[Array, Array]:
        """Return position [m] (2,) and velocity [m/s] (2,) at time t [s]."""
        ...


@dataclass(frozen=True)
class Standing:
    """A fixed point.

    Attributes:
        position: Where it stands [m].
    """

    position: tuple[float, float]

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the fixed point and no velocity."""
        return np.array(self.position), np.zeros(2)


@dataclass(frozen=True)
class Circle:
    """A circle at constant speed; counterclockwise if the speed is positive.

    Attributes:
        centre: Its centre [m].
        radius: Its radius [m].
        speed: Signed speed along it [m/s].
        phase: Angle at t = 0, from the x axis [rad].
    """

    centre: tuple[float, float]
    radius: float
    speed: float
    phase: float = 0.0

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the point of the circle and its tangential velocity."""
        angle = self.phase + self.speed / self.radius * t
        outward = np.array([math.cos(angle), math.sin(angle)])
        tangent = np.array([-outward[1], outward[0]])
        return np.array(self.centre) + self.radius * outward, self.speed * tangent


@dataclass(frozen=True)
class Line:
    """A segment walked to and fro, with a rest at each end: nobody turns in no time.

    Attributes:
        start, end: Its end points [m]; the motion begins at start.
        speed: Speed along it [m/s].
        phase: Part of a whole to-and-fro cycle already done at t = 0, in [0, 1).
        acceleration: How fast it speeds up and slows down at the ends [m/s^2];
            math.inf for a turn in no time.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    speed: float
    phase: float = 0.0
    acceleration: float = 0.5

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the point of the segment and its velocity."""
        start, along = np.array(self.start), np.subtract(self.end, self.start)
        length = math.hypot(*along)
        peak = min(self.speed, math.sqrt(self.acceleration * length))
        if peak == 0.0:
            return start + self._share(self.phase) * along, np.zeros(2)
        one_way = length / peak + peak / self.acceleration
        done = (t / (2.0 * one_way) + self.phase) % 1.0
        position, speed = self._one_way(2.0 * min(done, 1.0 - done) * one_way, one_way, peak)
        heading = along / length
        return start + position * heading, math.copysign(speed, 0.5 - done) * heading

    @staticmethod
    def _share(phase: float) -> float:
        """Return how far along a body rests that never moves."""
        return 2.0 * min(phase, 1.0 - phase)

    def _one_way(self, t: float, one_way: float, peak: float) -> tuple[float, float]:
        """Return way done [m] and speed [m/s], t [s] after a rest at one end."""
        ramp = peak / self.acceleration
        if t < ramp:
            return 0.5 * self.acceleration * t * t, self.acceleration * t
        left = one_way - t
        if left < ramp:
            length = peak * (one_way - ramp)
            return length - 0.5 * self.acceleration * left * left, self.acceleration * left
        return peak * (t - 0.5 * ramp), peak


@dataclass(frozen=True)
class Waypoints:
    """A polyline walked once at constant speed; it ends standing at the last point.

    Attributes:
        points: The corners [m], at least two.
        speed: Speed along it [m/s].
    """

    points: tuple[tuple[float, float], ...]
    speed: float

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the point of the polyline and its velocity."""
        left = self.speed * t
        corners = np.array(self.points)
        for corner, following in itertools.pairwise(corners):
            along = following - corner
            length = math.hypot(*along)
            if left < length:
                return corner + along * (left / length), along * (self.speed / length)
            left -= length
        return corners[-1], np.zeros(2)
