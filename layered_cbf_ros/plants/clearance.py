"""Surface distance and contact force of every pair of bodies, as Bullet has them.

Bullet's own query between two whole robots tries all pairs of links. Here each
link's bounding sphere gives a lower bound for every pair of links in one go, and
only pairs whose bound lies below the best distance so far are asked exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.plants.bullet_robot import TRUNK, BulletRobot
from layered_cbf_ros.scenario import Obstacle, Scenario, Wall

_REACH = 0.72  # no part of an A1 is farther from its trunk's centre [m]


@dataclass(frozen=True, slots=True)
class _Pair:
    """A robot, and the robot, obstacle or wall (or None: the ground) it may touch."""

    label: str
    robot: int
    other: int | Obstacle | Wall | None
    body: int


class ClearanceMeter:
    """Measures the pairs of one world.

    Attributes:
        labels: Label of each pair.
        index: Number of a pair by Bullet's two body numbers, robot first.
    """

    def __init__(
        self,
        client: Any,
        scenario: Scenario,
        robots: Sequence[BulletRobot],
        fixtures: dict[str, int],
        exact_within: float,
    ) -> None:
        """List the pairs.

        Args:
            client: Connection to the world.
            scenario: What is in it.
            robots: Its robots, in the scenario's order.
            fixtures: Bullet's number of each obstacle, each wall and 'ground'.
            exact_within: Distance up to which distances are exact [m].
        """
        self._client, self._robots, self._exact_within = client, robots, exact_within
        self._pairs = _list_pairs(scenario, robots, fixtures)
        self.labels = tuple(pair.label for pair in self._pairs)
        self.index = {(robots[pair.robot].body, pair.body): k for k, pair in enumerate(self._pairs)}
        spheres = [_bounding_sphere(client, robots[0].body, link) for link in robots[0].links]
        self._offsets = np.array([offset for offset, _ in spheres])
        self._radii = np.array([radius for _, radius in spheres])
        self._radii_sum = self._radii[:, None] + self._radii

    def distances(self, t: float) -> Array:
        """Return the distance of each pair [m], (P,), obstacles as at time t [s]."""
        trunks = np.array([robot.centre for robot in self._robots])
        centres: dict[int, Array] = {}
        result = np.empty(len(self._pairs))
        for k, pair in enumerate(self._pairs):
            coarse = self._coarse_bound(pair, trunks, t)
            if coarse >= self._exact_within:
                result[k] = coarse
                continue
            other = pair.other
            if other is None:
                result[k] = self._asked(pair, TRUNK, TRUNK, self._exact_within)
                continue
            for robot in (pair.robot, other):
                if isinstance(robot, int) and robot not in centres:
                    centres[robot] = self._link_centres(self._robots[robot])
            result[k] = self._closest(pair, self._bounds(centres[pair.robot], other, centres, t))
        return result

    def _coarse_bound(self, pair: _Pair, trunks: Array, t: float) -> float:
        """Return a lower bound of a pair's distance [m], from the trunks alone."""
        x, y, z = trunks[pair.robot].tolist()
        other = pair.other
        if other is None:
            return z - _REACH
        if isinstance(other, int):
            return math.dist((x, y, z), trunks[other].tolist()) - 2.0 * _REACH
        if isinstance(other, Wall):
            (px, py), (nx, ny) = other.point, other.normal
            return (x - px) * nx + (y - py) * ny - _REACH
        px, py = other.motion.at(t)[0].tolist()
        return math.hypot(x - px, y - py) - other.radius - _REACH

    def _bounds(
        self, own: Array, other: int | Obstacle | Wall, centres: dict[int, Array], t: float
    ) -> Array:
        """Return a lower bound for each link of the robot (and of the other) [m]."""
        if isinstance(other, int):
            apart = own[:, None, :] - centres[other]
            return np.sqrt((apart * apart).sum(axis=2)) - self._radii_sum
        if isinstance(other, Wall):
            return (own[:, :2] - other.point) @ np.array(other.normal) - self._radii
        apart = own[:, :2] - other.motion.at(t)[0]
        return np.hypot(apart[:, 0], apart[:, 1]) - other.radius - self._radii

    def _closest(self, pair: _Pair, bounds: Array) -> float:
        """Return the smallest distance of a pair [m], by branch and bound."""
        links = self._robots[pair.robot].links
        best = self._exact_within
        candidates = np.flatnonzero(bounds < best)
        bounds = bounds.ravel()[candidates]
        for k in np.argsort(bounds):
            if bounds[k] >= best:
                break
            own, other = int(candidates[k]), 0
            if isinstance(pair.other, int):
                own, other = divmod(own, len(links))
            best = self._asked(pair, links[own], links[other], best)
        return best

    def _asked(self, pair: _Pair, link: int, other_link: int, at_most: float) -> float:
        """Return Bullet's distance of two links, if it is below a limit, else that [m]."""
        points = self._client.getClosestPoints(
            self._robots[pair.robot].body, pair.body, at_most, link, other_link
        )
        return float(min((point[8] for point in points), default=at_most))

    def _link_centres(self, robot: BulletRobot) -> Array:
        """Return the centre of each link's bounding sphere, world [m], (L, 3)."""
        # Unless asked to recompute, Bullet returns link poses of the step before.
        links = self._client.getLinkStates(
            robot.body, robot.links[1:], computeForwardKinematics=True
        )
        positions = np.array([robot.centre, *[link[0] for link in links]])
        quaternions = np.array([robot.inertial_quaternion, *[link[1] for link in links]])
        return positions + _rotated(quaternions, self._offsets)


def _list_pairs(
    scenario: Scenario, robots: Sequence[BulletRobot], fixtures: dict[str, int]
) -> list[_Pair]:
    names = [robot.name for robot in scenario.robots]
    pairs = [
        _Pair(f'{a}~{names[j]}', i, j, robots[j].body)
        for i, a in enumerate(names)
        for j in range(i + 1, len(names))
    ]
    things: tuple[Obstacle | Wall, ...] = (*scenario.obstacles, *scenario.walls)
    pairs += [
        _Pair(f'{a}~{thing.name}', i, thing, fixtures[thing.name])
        for thing in things
        for i, a in enumerate(names)
    ]
    pairs += [_Pair(f'{a}~ground', i, None, fixtures['ground']) for i, a in enumerate(names)]
    return pairs


def _bounding_sphere(client: Any, body: int, link: int) -> tuple[tuple[float, ...], float]:
    """Return centre, in the link's inertial frame, and radius of a link's sphere [m]."""
    (shape,) = client.getCollisionShapeData(body, link)
    kind, size, offset = shape[2], shape[3], shape[5]
    if kind == pybullet.GEOM_SPHERE:
        return offset, size[0]
    if kind == pybullet.GEOM_BOX:
        return offset, 0.5 * math.hypot(*size)
    length, radius = size[:2]
    return offset, math.hypot(0.5 * length, radius)


def _rotated(quaternions: Array, vectors: Array) -> Array:
    """Return v + 2 w (u x v) + 2 u x (u x v), for quaternions (u, w); (K, 3)."""
    x, y, z, w = quaternions.T
    a, b, c = vectors.T
    # t = 2 u x v
    ta, tb, tc = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return np.stack(
        [
            a + w * ta + y * tc - z * tb,
            b + w * tb + z * ta - x * tc,
            c + w * tc + x * tb - y * ta,
        ],
        axis=1,
    )
