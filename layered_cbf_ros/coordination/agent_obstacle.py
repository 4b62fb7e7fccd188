"""Agents keep away from obstacles: one row for every agent and obstacle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.barriers import Rows, Scene, high_order, no_rows, separation
from layered_cbf_ros.coordination.collision_ball import collision_balls
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.reachable_sets import agent_reach, obstacle_reach
from layered_cbf_ros.interfaces import Array


class AgentObstacle:
    """Barrier between every agent and every obstacle; only the agent can yield."""

    def __init__(
        self, names: Sequence[str], radii: Array, parameters: CoordinatorParameters
    ) -> None:
        self._names = tuple(names)
        self._radii = radii
        self._parameters = parameters
        agents = np.arange(len(names))
        counts = range(parameters.max_obstacles + 1)
        self._agent = [np.repeat(agents, count) for count in counts]
        self._body = [np.tile(np.arange(count), len(names)) for count in counts]

    @property
    def weight(self) -> float:
        """Return the linear penalty of a slack [s^2/m]."""
        return self._parameters.slack_weight

    def size(self, bodies: int) -> int:
        """Return agents times bodies."""
        return len(self._names) * bodies

    def rows(self, scene: Scene) -> Rows:
        """Return the rows agent by agent; paper eq. (13) to (20)."""
        p, bodies = self._parameters, scene.bodies
        if not bodies.names:
            return no_rows(len(self._names))
        agent, body = self._agent[len(bodies.names)], self._body[len(bodies.names)]
        position, velocity = scene.position[agent], scene.velocity[agent]
        body_velocity = bodies.velocity[body]
        gap = separation(position, velocity, bodies.position[body], body_velocity)
        target = scene.target[agent]
        reach = agent_reach(
            gap.direction, velocity, target, p.horizon, p.beta[1], p.acceleration_limit
        )
        ball = obstacle_reach(gap.direction, body_velocity, bodies.horizon[body])
        ball += (bodies.growth + bodies.radius)[body] + self._radii[agent]
        balls = collision_balls(position, gap.direction, gap.distance, reach, ball)

        psi0 = balls.barrier
        psi1, bound = high_order(psi0, gap.rate, gap.centrifugal, p.alpha1, p.alpha2)
        coefficients = np.zeros((len(agent), len(self._names), 2))
        coefficients[np.arange(len(agent)), agent] = -gap.direction
        if scene.any_held:
            coefficients[:, scene.held] = 0.0
            bound[scene.held[agent]] = 0.0
        labels = tuple(f'{name}~{other}' for name in self._names for other in bodies.names)
        return Rows(labels, coefficients, bound, psi0, psi1, balls.centre, balls.radius)
