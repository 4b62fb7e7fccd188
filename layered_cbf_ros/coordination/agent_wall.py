"""Agents keep inside walls: one row for every agent and wall."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.barriers import Rows, Scene, high_order
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Wall


class AgentWall:
    """Barrier h = n . (phi_i - p) - r_i: the body stays on the allowed side.

    A wall stands still, so its own reachable set is a half-plane without growth.
    """

    def __init__(
        self,
        names: Sequence[str],
        radii: Array,
        walls: Sequence[Wall],
        parameters: CoordinatorParameters,
    ) -> None:
        self._parameters = parameters
        self._labels = tuple(f'{name}~{wall.name}' for name in names for wall in walls)
        self._agent = np.repeat(np.arange(len(names)), len(walls))
        normal = np.array([wall.normal for wall in walls], dtype=float).reshape(-1, 2)
        point = np.array([wall.point for wall in walls], dtype=float).reshape(-1, 2)
        self._normal = np.tile(normal, (len(names), 1))
        self._offset = np.tile((normal * point).sum(axis=1), len(names)) + radii[self._agent]
        self._coefficients = np.zeros((len(self._labels), len(names), 2))
        self._coefficients[np.arange(len(self._labels)), self._agent] = self._normal
        self._no_drift = np.zeros(len(self._labels))

    @property
    def weight(self) -> float:
        """Return the linear penalty of a slack [s^2/m]."""
        return self._parameters.slack_weight

    def size(self, bodies: int) -> int:
        """Return agents times walls."""
        return len(self._labels)

    def rows(self, scene: Scene) -> Rows:
        """Return the rows agent by agent; h'' = n . u."""
        p = self._parameters
        psi0 = np.einsum('ij,ij->i', self._normal, scene.position[self._agent]) - self._offset
        rate = np.einsum('ij,ij->i', self._normal, scene.velocity[self._agent])
        psi1, bound = high_order(psi0, rate, self._no_drift, p.wall_alpha1, p.wall_alpha2)
        coefficients = self._coefficients
        if scene.any_held:
            coefficients = coefficients.copy()
            coefficients[:, scene.held] = 0.0
            bound[scene.held[self._agent]] = 0.0
        none = np.zeros((0, 2))
        return Rows(self._labels, coefficients, bound, psi0, psi1, none, none[:, 0])
