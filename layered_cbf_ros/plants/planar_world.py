"""A simulated plant without legs: bases that follow a velocity, moving cylinders and walls.

A base follows what it is told with a first-order lag and a limited acceleration, forward,
left and in turn. A unicycle can't go sideways. Bodies do not stop each other: that they
touched is told. The same commands give the same states, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array, BaseState
from layered_cbf_ros.plants.clearance_report import ClearanceReport
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.plants.planar_gaps import PlanarGaps
from layered_cbf_ros.scenario import UNICYCLE, Scenario

STEP_NS = 1_000_000
NOMINAL_STIFFNESS = 1e4
"""Force per penetration that a contact is told with: these bodies have no mass [N/m]."""


class PlanarWorld:
    """A scenario's bases, obstacles and walls."""

    def __init__(
        self,
        scenario: Scenario,
        parameters: SimulatorParameters,
        radii: Sequence[float],
        offsets: Sequence[float],
    ) -> None:
        """Build the world at time 0.

        Args:
            scenario: What is in it.
            parameters: Of the simulator.
            radii: Of the bases' discs [m], (N,).
            offsets: How far the centre of each disc is ahead of the base's own [m], (N,).
        """
        robots = scenario.robots
        self._scenario = scenario
        self._drives = np.array([robot.kind == UNICYCLE for robot in robots], dtype=bool)
        self._ahead = np.array(offsets, dtype=float)
        self._yaws = np.array([robot.yaw for robot in robots], dtype=float)
        discs = np.array([robot.position for robot in robots], dtype=float)
        self._positions = discs - self._ahead[:, None] * _headings(self._yaws)
        self._twists = np.zeros((len(robots), 3))
        self._parameters = parameters
        self._share = -math.expm1(-STEP_NS / NS_PER_S / parameters.base_lag)
        bodies = np.maximum(np.array(radii) - parameters.base_margin, 0.01)
        self._gaps = PlanarGaps(scenario, bodies)
        self._depths = np.zeros(len(self._gaps.labels))
        self._stamp_ns = 0

    @property
    def stamp_ns(self) -> int:
        """Time of the present state [ns]."""
        return self._stamp_ns

    @property
    def discs(self) -> Array:
        """Return the centres of the bases' discs [m], (N, 2)."""
        return self._positions + self._ahead[:, None] * _headings(self._yaws)

    def states(self) -> tuple[BaseState, ...]:
        """Return the present state of each base, as its own odometry has it."""
        velocities = self._velocities()
        rows = zip(
            self._positions, velocities, self._yaws.tolist(), self._twists[:, 2], strict=True
        )
        return tuple(
            BaseState(self._stamp_ns, place.copy(), velocity, yaw, float(rate))
            for place, velocity, yaw, rate in rows
        )

    def step(self, commands: Array) -> None:
        """Go on by one step.

        Args:
            commands: Forward, left [m/s] and turn [rad/s] that each base is told, (N, 3).
        """
        p, dt = self._parameters, STEP_NS / NS_PER_S
        wanted = commands.copy()
        wanted[self._drives, 1] = 0.0
        change = self._share * (wanted - self._twists)
        size = np.maximum(np.hypot(change[:, 0], change[:, 1]), p.base_acceleration * dt)
        change[:, :2] *= (p.base_acceleration * dt / size)[:, None]
        turn = p.base_yaw_acceleration * dt
        change[:, 2] = np.minimum(np.maximum(change[:, 2], -turn), turn)
        self._twists += change
        self._positions += dt * self._velocities()
        self._yaws += dt * self._twists[:, 2]
        self._stamp_ns += STEP_NS
        self._depths = np.maximum(self._depths, -self._distances())

    def obstacle_positions(self) -> Array:
        """Return the true centre of each obstacle [m], (M, 2)."""
        t = self._stamp_ns / NS_PER_S
        centres = [thing.motion.at(t)[0] for thing in self._scenario.obstacles]
        return np.array(centres).reshape(-1, 2)

    def clearances(self) -> ClearanceReport:
        """Return how close all pairs are, and the peak forces since the last call."""
        forces, self._depths = NOMINAL_STIFFNESS * self._depths, np.zeros_like(self._depths)
        return ClearanceReport(self._stamp_ns, self._gaps.labels, self._distances(), forces)

    def _distances(self) -> Array:
        return self._gaps.distances(self.discs, self.obstacle_positions())

    def _velocities(self) -> Array:
        """Return the velocities of the bases in the world [m/s], (N, 2)."""
        forward = _headings(self._yaws)
        left = np.column_stack((-forward[:, 1], forward[:, 0]))
        return self._twists[:, :1] * forward + self._twists[:, 1:2] * left


def _headings(yaws: Array) -> Array:
    """Return the unit vectors forward, (N, 2)."""
    return np.column_stack((np.cos(yaws), np.sin(yaws)))
