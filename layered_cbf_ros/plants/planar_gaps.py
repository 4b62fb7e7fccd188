"""Surface distances between upright cylinders, and between them and walls."""

from __future__ import annotations

import itertools

import numpy as np

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Scenario


class PlanarGaps:
    """Measures every pair of one world of discs.

    Attributes:
        labels: `a~b` of each pair: base~base, base~obstacle, base~wall.
    """

    def __init__(self, scenario: Scenario, radii: Array) -> None:
        """List the pairs.

        Args:
            scenario: Who is there.
            radii: Of the bases' bodies [m], (N,).
        """
        robots = [robot.name for robot in scenario.robots]
        obstacles, walls = scenario.obstacles, scenario.walls
        pairs = list(itertools.combinations(range(len(robots)), 2))
        self._first = np.array([i for i, _ in pairs], dtype=np.intp)
        self._second = np.array([j for _, j in pairs], dtype=np.intp)
        self._radii = radii
        self._obstacle_radii = np.array([obstacle.radius for obstacle in obstacles])
        self._normals = np.array([wall.normal for wall in walls]).reshape(-1, 2)
        points = np.array([wall.point for wall in walls]).reshape(-1, 2)
        self._offsets = (self._normals * points).sum(axis=1)
        others = [*(obstacle.name for obstacle in obstacles), *(wall.name for wall in walls)]
        self.labels = tuple(
            [f'{robots[i]}~{robots[j]}' for i, j in pairs]
            + [f'{robot}~{other}' for other in others for robot in robots]
        )

    def distances(self, centres: Array, obstacles: Array) -> Array:
        """Return the distance of each pair, negative in penetration [m], (P,).

        Args:
            centres: Of the bases [m], (N, 2).
            obstacles: Centres of the obstacles [m], (M, 2).
        """
        apart = centres[self._first] - centres[self._second]
        sizes = self._radii[self._first] + self._radii[self._second]
        away = obstacles[:, None] - centres
        reach = self._obstacle_radii[:, None] + self._radii
        room = (self._normals[:, None] * centres).sum(axis=2) - self._offsets[:, None]
        return np.concatenate(
            (
                np.hypot(apart[:, 0], apart[:, 1]) - sizes,
                (np.hypot(away[..., 0], away[..., 1]) - reach).ravel(),
                (room - self._radii).ravel(),
            )
        )
