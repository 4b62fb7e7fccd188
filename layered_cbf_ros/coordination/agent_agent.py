"""Agents keep apart from each other: one row a pair."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.barriers import Rows, Scene, high_order, no_rows, separation
from layered_cbf_ros.coordination.collision_ball import collision_balls
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.reachable_sets import agent_reach, obstacle_reach
from layered_cbf_ros.interfaces import Array


class AgentAgent:
    """Barrier between every two agents.

    Both directions (i towards the ball of j, and j towards the ball of i) have the
    same derivatives, so only the smaller h matters: one row a pair. A held agent
    can't obey: it gets no coefficients and the set of a body with unknown law.
    """

    def __init__(
        self, names: Sequence[str], radii: Array, parameters: CoordinatorParameters
    ) -> None:
        self._parameters = parameters
        pairs = list(itertools.combinations(range(len(names)), 2))
        first = np.array([i for i, _ in pairs], dtype=np.intp)
        second = np.array([j for _, j in pairs], dtype=np.intp)
        self._labels = tuple(f'{names[i]}~{names[j]}' for i, j in pairs)
        self._rows = np.arange(len(pairs))
        self._first, self._second = first, second
        self._both_ways = np.concatenate((first, second))
        self._sizes = np.tile(radii[first] + radii[second], 2)
        self._agents = len(names)

    @property
    def weight(self) -> float:
        """Return the linear penalty of a slack [s^2/m]."""
        return self._parameters.slack_weight

    def size(self, bodies: int) -> int:
        """Return the number of pairs."""
        return len(self._labels)

    def rows(self, scene: Scene) -> Rows:
        """Return one row a pair; paper eq. (13) to (20)."""
        p, pairs = self._parameters, len(self._labels)
        if not pairs:
            return no_rows(self._agents)
        one, other = self._first, self._second
        position, velocity = scene.position[self._both_ways], scene.velocity[self._both_ways]
        gap = separation(position[:pairs], velocity[:pairs], position[pairs:], velocity[pairs:])
        direction = np.concatenate((gap.direction, -gap.direction))
        reach = self._reach(scene, direction, velocity)
        ball = np.concatenate((reach[pairs:], reach[:pairs])) + self._sizes
        distance = np.concatenate((gap.distance, gap.distance))
        balls = collision_balls(position, direction, distance, reach, ball)

        nearer = np.where(balls.barrier[pairs:] < balls.barrier[:pairs], pairs, 0) + self._rows
        psi0 = balls.barrier[nearer]
        psi1, bound = high_order(psi0, gap.rate, gap.centrifugal, p.alpha1, p.alpha2)
        coefficients = np.zeros((pairs, self._agents, 2))
        coefficients[self._rows, one] = -gap.direction
        coefficients[self._rows, other] = gap.direction
        if scene.any_held:
            coefficients[:, scene.held] = 0.0
            bound[scene.held[one] & scene.held[other]] = 0.0
        centre, radius = balls.centre[nearer], balls.radius[nearer]
        return Rows(self._labels, coefficients, bound, psi0, psi1, centre, radius)

    def _reach(self, scene: Scene, direction: Array, velocity: Array) -> Array:
        p = self._parameters
        target = scene.target[self._both_ways]
        reach = agent_reach(direction, velocity, target, p.horizon, p.beta[1], p.acceleration_limit)
        if scene.any_held:
            unknown = obstacle_reach(direction, velocity, p.horizon)
            reach = np.where(scene.held[self._both_ways], unknown, reach)
        return reach
