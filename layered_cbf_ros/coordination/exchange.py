"""What goes into one tick of the coordinator and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.coordination.plan import CoordinationState
from layered_cbf_ros.coordination.planner_qp import QpStatus
from layered_cbf_ros.interfaces import Array, PlannedMotion, Track, VelocityCommand


@dataclass(frozen=True, slots=True)
class CoordinationInputs:
    """What the coordinator is told at one tick; world frame.

    Attributes:
        stamp_ns: Stamp of the measured states [ns].
        positions: Measured CoM positions [m], (N, 2); NaN where unknown.
        velocities: Measured CoM velocities [m/s], (N, 2); NaN where unknown.
        fallen: Robots that lie or don't answer, (N,).
        tracks: Everybody else.
        commands: A velocity asked for from outside, or None, for each robot.
        yaws: Measured headings [rad], (N,); NaN where unknown.
        stopped: The emergency stop: everybody brakes, then sits down.
    """

    stamp_ns: int
    positions: Array
    velocities: Array
    fallen: NDArray[np.bool_]
    tracks: tuple[Track, ...]
    commands: tuple[VelocityCommand | None, ...]
    yaws: Array
    stopped: bool = False


@dataclass(frozen=True, slots=True)
class CoordinationResult:
    """What one tick gives; M rows, P balls.

    Attributes:
        state: The plan one period later.
        motions: The plan at the stamp of the inputs, one a robot.
        target: Desired velocities [m/s], (N, 2); they shape the reachable sets.
        u, u_desired: Applied and desired inputs [m/s^2], (N, 2).
        held: Robots that can't obey: frozen, or told to stand, (N,).
        labels: What each row keeps apart.
        psi0, psi1, psi2: Barrier functions [m], [m/s], [m/s^2], (M,) each; psi2 with
            the applied input.
        slack: By how much each row was given up [m/s^2], (M,).
        ball_labels: Pairs that have a collision ball.
        q, r: Their centres in the world [m], (P, 2), and radii [m], (P,).
        status: How the QP ended.
        solver_failed: The QP gave nothing usable: everybody brakes.
        slack_event: A row was given up by more than the tolerance.
        alarms: Robots whose plan is frozen, (N,).
        rejected: Tracks, commands and measured states that weren't finite.
        tracks_left_out: Tracks beyond the number that fits.
    """

    state: CoordinationState
    motions: tuple[PlannedMotion, ...]
    target: Array
    u: Array
    u_desired: Array
    held: NDArray[np.bool_]
    labels: tuple[str, ...]
    psi0: Array
    psi1: Array
    psi2: Array
    slack: Array
    ball_labels: tuple[str, ...]
    q: Array
    r: Array
    status: QpStatus
    solver_failed: bool
    slack_event: bool
    alarms: NDArray[np.bool_]
    rejected: int
    tracks_left_out: int
