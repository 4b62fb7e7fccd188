"""When a run has done what its robots wanted."""

from __future__ import annotations

import math
from collections.abc import Sequence

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.scenario import Scenario

DWELL_NS = NS_PER_S  # a robot that only passes its goal has not reached it


class GoalWatch:
    """Watches the robots that have a goal; without any the run lasts its full time."""

    def __init__(self, scenario: Scenario) -> None:
        self._goals = {
            i: robot.desired.goal
            for i, robot in enumerate(scenario.robots)
            if robot.desired.goal is not None
        }
        self._tolerance = scenario.goal_tolerance
        self._there_since: int | None = None
        self._now_ns = 0

    def watch(self, stamp_ns: int, positions: Sequence[Array]) -> None:
        """Note where the robots are.

        Args:
            stamp_ns: When [ns].
            positions: Of each robot in the plane [m], (2,).
        """
        self._now_ns = stamp_ns
        there = all(
            math.dist(positions[i], goal) <= self._tolerance for i, goal in self._goals.items()
        )
        if not there:
            self._there_since = None
        elif self._there_since is None:
            self._there_since = self._now_ns

    @property
    def all_reached(self) -> bool:
        """Tell whether every robot with a goal has been there for a while."""
        if not self._goals or self._there_since is None:
            return False
        return self._now_ns - self._there_since >= DWELL_NS
