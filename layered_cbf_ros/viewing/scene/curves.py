"""Figures over the last seconds: of each pair if there are few, else the worst of each robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

WINDOW_S = 15.0
PERIOD_NS = NS_PER_S // 12
JUMP_NS = 2 * NS_PER_S
"""A larger step in time is a jump: curves begin anew."""
MOST_PAIRS = 6
DISTANCE, PSI0, PSI1, INTERVENTION = 'distance [m]', 'psi0 [m]', 'psi1 [m/s]', '|u - u_des| [m/s²]'
TITLES = (DISTANCE, PSI0, PSI1, INTERVENTION)


class Curves:
    """Gathers what the plots show; its only memory are the last seconds."""

    def __init__(self) -> None:
        length = round(WINDOW_S * NS_PER_S / PERIOD_NS) + 1
        self._rows: deque[tuple[int, dict[str, dict[str, float]]]] = deque(maxlen=length)

    def add(self, snapshot: Snapshot) -> bool:
        """Take one instant; return whether it was late enough to count."""
        if self._rows:
            age_ns = snapshot.stamp_ns - self._rows[-1][0]
            if not 0 <= age_ns <= JUMP_NS:
                self._rows.clear()
            elif age_ns < PERIOD_NS:
                return False
        self._rows.append((snapshot.stamp_ns, figures(snapshot)))
        return True

    def clear(self) -> None:
        """Forget all."""
        self._rows.clear()

    def table(self, title: str) -> tuple[tuple[str, ...], Array]:
        """Return the curves of one plot.

        Returns:
            Their labels (n,), and the time [s] followed by a row for each, (1 + n, k), of
            the instants at which all were known.
        """
        labels = tuple(dict.fromkeys(name for _, row in self._rows for name in row[title]))
        table = np.full((1 + len(labels), len(self._rows)), np.nan)
        for column, (stamp_ns, row) in enumerate(self._rows):
            table[0, column] = stamp_ns / NS_PER_S
            for k, label in enumerate(labels, 1):
                table[k, column] = row[title].get(label, np.nan)
        return labels, table[:, np.isfinite(table).all(axis=0)]


def figures(snapshot: Snapshot) -> dict[str, dict[str, float]]:
    """Return the figures of an instant, by plot and label."""
    robots = [robot.name for robot in snapshot.robots]
    return {
        DISTANCE: readable(snapshot.distances, robots),
        PSI0: readable({pair.label: pair.psi0 for pair in snapshot.barriers}, robots),
        PSI1: readable({pair.label: pair.psi1 for pair in snapshot.barriers}, robots),
        INTERVENTION: {robot.name: robot.intervention for robot in snapshot.robots},
    }


def readable(pairs: Mapping[str, float], robots: list[str]) -> dict[str, float]:
    """Return the values of all pairs `a~b`; of too many, the smallest one of each robot."""
    if len(pairs) <= MOST_PAIRS:
        return dict(pairs)
    smallest: dict[str, float] = {}
    for label, value in pairs.items():
        for name in label.split('~'):
            if name in robots:
                smallest[name] = min(value, smallest.get(name, value))
    return smallest
