"""When a robot doesn't follow its plan: the plan freezes where the robot is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from layered_cbf_ros.coordination.exchange import CoordinationInputs
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.plan import CoordinationState


def alarmed(
    state: CoordinationState, inputs: CoordinationInputs, parameters: CoordinatorParameters
) -> tuple[CoordinationState, int]:
    """Freeze the plans of robots that have fallen or left their plan.

    A plan freezes at the measured pose, at rest, when its robot has fallen or is
    farther than tracking_alarm away. It goes on once the robot is up and slower than
    release_speed. A robot of which nothing is known raises no alarm.

    Args:
        state: The plan.
        inputs: Measured states; a row that isn't finite counts as unknown.
        parameters: Thresholds.

    Returns:
        The plan with its frozen flags, and the number of unknown robots.
    """
    p = parameters
    away = inputs.positions - state.positions
    error, speed_squared = np.vdot(away, away), np.vdot(inputs.velocities, inputs.velocities)
    calm = error < p.tracking_alarm**2 and math.isfinite(speed_squared)
    if calm and not inputs.fallen.any() and not state.frozen.any():
        return state, 0  # all known, all together nearer than one may be: the usual tick
    known = np.isfinite((inputs.positions + inputs.velocities).sum(axis=1))
    unknown = len(state.positions) - int(np.count_nonzero(known))
    lost = known & (np.hypot(away[:, 0], away[:, 1]) > p.tracking_alarm)
    frozen = inputs.fallen | lost
    if state.frozen.any():
        speed = np.hypot(inputs.velocities[:, 0], inputs.velocities[:, 1])
        frozen |= state.frozen & ~(known & (speed < p.release_speed))
    if not frozen.any():
        return replace(state, frozen=frozen), unknown
    positions, velocities = state.positions.copy(), state.velocities.copy()
    positions[frozen & known] = inputs.positions[frozen & known]
    velocities[frozen] = 0.0
    changed = replace(
        state,
        positions=positions,
        velocities=velocities,
        yaws=np.where(frozen & np.isfinite(inputs.yaws), inputs.yaws, state.yaws),
        yaw_rates=np.where(frozen, 0.0, state.yaw_rates),
        frozen=frozen,
    )
    return changed, unknown
