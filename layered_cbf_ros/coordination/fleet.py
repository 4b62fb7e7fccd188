"""Bases with their own locomotion under the coordinator: what counts as where they are, and
what each is told.

A robot that moves in every direction is coordinated at its centre. A unicycle can't go
sideways, and no velocity of its axle follows every plan; but the point ahead of the axle by
a length l can be moved in every direction, for R(yaw) diag(1, l) is invertible: the velocity
(x, y) of this point, in the frame of the base, is had by driving at x and turning at y / l.
So this point is coordinated, and the disc must hold the base around it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.desired_motion import rotated
from layered_cbf_ros.coordination.exchange import CoordinationResult
from layered_cbf_ros.coordination.fleet_parameters import FleetParameters
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import Array, BaseState, PlannedMotion
from layered_cbf_ros.scenario import UNICYCLE, Robot


class Fleet:
    """The bases of one team."""

    def __init__(
        self,
        robots: Sequence[Robot],
        parameters: FleetParameters,
        limits: CoordinatorParameters,
    ) -> None:
        """Begin.

        Args:
            robots: The bases.
            parameters: How they are told what to do.
            limits: Of the plan; no base is told more.
        """
        self._drives = [robot.kind == UNICYCLE for robot in robots]
        self._parameters, self._limits = parameters, limits

    def coordinated(self, bases: Sequence[BaseState | None]) -> list[BaseState | None]:
        """Return the motion of the point of each base that is coordinated."""
        length = self._parameters.unicycle_ahead
        return [
            base.ahead(length) if base is not None and drives else base
            for base, drives in zip(bases, self._drives, strict=True)
        ]

    def commands(self, result: CoordinationResult, points: Sequence[BaseState | None]) -> Array:
        """Return forward, left [m/s] and turn [rad/s] that each base is told, (N, 3).

        Who is unknown, or can't obey, is told to stand.

        Args:
            result: Of the tick.
            points: As from `coordinated`, at the tick.
        """
        told = np.zeros((len(points), 3))
        for k, (motion, point) in enumerate(zip(result.motions, points, strict=True)):
            if point is None or result.held[k]:
                continue
            x, y, turn = self._followed(motion, point)
            if self._drives[k]:
                turn = y / self._parameters.unicycle_ahead
                y = 0.0
            told[k] = x, y, turn
        return told

    def _followed(self, motion: PlannedMotion, point: BaseState) -> tuple[float, float, float]:
        """Return the velocity that leads a point back to its plan, in its base's frame.

        v + t u + k (p - p_measured) in the world, within the speed limit: t makes up for
        the lag of the base.
        """
        p, limits = self._parameters, self._limits
        wish = motion.velocity + p.velocity_lead * motion.acceleration
        x, y = (wish + p.position_gain * (motion.position - point.position)).tolist()
        scale = min(1.0, limits.speed_limit / max(abs(x), abs(y), 1e-9))
        x, y = rotated(scale * x, scale * y, -point.yaw)
        error = math.remainder(motion.yaw - point.yaw, math.tau)
        turn = motion.yaw_rate + p.yaw_gain * error
        return x, y, min(max(turn, -limits.yaw_rate_limit), limits.yaw_rate_limit)
