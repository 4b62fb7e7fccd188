"""How near planned bodies come to each other, and where they would overlap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from layered_cbf_ros.scenario import Wall

TOLERANCE = 1e-3
"""Less than this is no overlap: a plan holds its inputs for a period [m]."""

KEPT_NS = 2_000_000_000
"""Stamps at which only one of two bodies is known are forgotten after this [ns]."""

Point = Sequence[float]


@dataclass
class Overlap:
    """Two bodies closer than the sum of their radii.

    Attributes:
        pair: `a~b`.
        begin_s, end_s: From when to when, since the start of the plan [s].
        depth_m: By how much at most [m].
        deepest_s: When that was [s].
    """

    pair: str
    begin_s: float
    end_s: float
    depth_m: float
    deepest_s: float


@dataclass
class Approach:
    """The smallest distance of a pair.

    Attributes:
        distance_m: Between the centres, or of a centre from a wall [m].
        promised_m: What the coordinator keeps: the sum of the radii [m].
        at_s: When that was, since the start of the plan [s].
    """

    distance_m: float
    promised_m: float
    at_s: float

    @property
    def margin_m(self) -> float:
        """Return the distance less the promised one [m]."""
        return self.distance_m - self.promised_m


class Distances:
    """Watches the planned discs of robots, walls, and whatever else moves."""

    def __init__(self, robots: Sequence[str], radius: float, walls: Sequence[Wall]) -> None:
        """Begin.

        Args:
            robots: Their names.
            radius: Of each robot's disc [m].
            walls: Half-planes to stay in.
        """
        self._robots, self._radius, self._walls = tuple(robots), radius, tuple(walls)
        self._plans: dict[int, Sequence[Point]] = {}
        self._others: dict[int, Mapping[str, tuple[Point, float]]] = {}
        self._begin_ns: int | None = None
        self._open: dict[str, Overlap] = {}
        self.approaches: dict[str, Approach] = {}
        self.overlaps: list[Overlap] = []

    def plan(self, stamp_ns: int, positions: Sequence[Point]) -> None:
        """Take the planned positions at a stamp [m], in the order of the robots."""
        self._begin_ns = stamp_ns if self._begin_ns is None else self._begin_ns
        both = zip(self._robots, positions, strict=True)
        for (a, here), (b, there) in itertools.combinations(both, 2):
            self._note(f'{a}~{b}', stamp_ns, math.dist(here, there), 2.0 * self._radius)
        for wall in self._walls:
            for name, (x, y) in zip(self._robots, positions, strict=True):
                room = wall.normal[0] * (x - wall.point[0]) + wall.normal[1] * (y - wall.point[1])
                self._note(f'{name}~{wall.name}', stamp_ns, room, self._radius)
        self._plans[stamp_ns] = positions
        self._meet(stamp_ns)

    def others(self, stamp_ns: int, bodies: Mapping[str, tuple[Point, float]]) -> None:
        """Take where everybody else is at a stamp: position and radius [m], by name."""
        self._others[stamp_ns] = {**self._others.get(stamp_ns, {}), **bodies}
        self._meet(stamp_ns)

    def _meet(self, stamp_ns: int) -> None:
        """Compare the robots with the others once both are known."""
        if stamp_ns in self._plans and stamp_ns in self._others:
            positions = self._plans[stamp_ns]
            for other, (place, radius) in self._others.pop(stamp_ns).items():
                for name, position in zip(self._robots, positions, strict=True):
                    distance = math.dist(position, place)
                    self._note(f'{name}~{other}', stamp_ns, distance, self._radius + radius)
        for waiting in (self._plans, self._others):
            while waiting and next(iter(waiting)) < stamp_ns - KEPT_NS:
                del waiting[next(iter(waiting))]

    def _note(self, pair: str, stamp_ns: int, distance: float, promised: float) -> None:
        at_s = (stamp_ns - (self._begin_ns or 0)) / 1e9
        nearest = self.approaches.get(pair)
        if nearest is None or distance < nearest.distance_m:
            self.approaches[pair] = Approach(distance, promised, at_s)
        depth, overlap = promised - distance, self._open.get(pair)
        if depth <= TOLERANCE:
            self._open.pop(pair, None)
        elif overlap is None:
            self._open[pair] = Overlap(pair, at_s, at_s, depth, at_s)
            self.overlaps.append(self._open[pair])
        else:
            overlap.end_s = at_s
            if depth > overlap.depth_m:
                overlap.depth_m, overlap.deepest_s = depth, at_s
