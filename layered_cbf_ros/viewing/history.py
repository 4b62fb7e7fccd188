"""What was before a picture: where robots came along, and how small h was."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

Row = TypeVar('Row', bound=tuple[Any, ...])
TRAIL_NS = 6 * NS_PER_S
CHART_NS = 20 * NS_PER_S
STEP_NS = NS_PER_S // 20  # points are no closer in time


@dataclass(frozen=True, slots=True)
class History:
    """The last seconds before a snapshot.

    Attributes:
        trails: Stamps [ns] and positions [m] of each robot: rows of stamp, x, y.
        barriers: Rows of stamp [ns] and the smallest h of all pairs [m].
    """

    trails: Mapping[str, tuple[tuple[int, float, float], ...]] = field(default_factory=dict)
    barriers: tuple[tuple[int, float], ...] = ()

    def trail(self, robot: str) -> Array:
        """Return where a robot was, the oldest first [m], (n, 2)."""
        rows = [(x, y) for _, x, y in self.trails.get(robot, ())]
        return np.array(rows).reshape(-1, 2)

    def after(self, snapshot: Snapshot) -> History:
        """Return the history with one snapshot more."""
        now_ns = snapshot.stamp_ns
        trails = {}
        for robot in snapshot.robots:
            x, y = robot.configuration[:2].tolist()
            trails[robot.name] = _grown(self.trails.get(robot.name, ()), (now_ns, x, y), TRAIL_NS)
        known = [pair.psi0 for pair in snapshot.barriers if math.isfinite(pair.psi0)]
        if not known:
            return History(trails, self.barriers)
        return History(trails, _grown(self.barriers, (now_ns, min(known)), CHART_NS))


def _grown(rows: tuple[Row, ...], row: Row, kept_ns: int) -> tuple[Row, ...]:
    """Return rows with one more, without those that are too old."""
    if rows and row[0] - rows[-1][0] < STEP_NS:
        return rows
    return (*(old for old in rows if row[0] - old[0] <= kept_ns), row)
