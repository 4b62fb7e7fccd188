"""The planner's own state: one double integrator a robot (paper eq. (10)).

The plan is a reference governor. It isn't reseeded from the measured robots, which
follow it a few millimetres behind; measurements only raise alarms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import NS_PER_S, Array, PlannedMotion


@dataclass(frozen=True, slots=True)
class CoordinationState:
    """The plan of N robots at one time, world frame.

    Attributes:
        stamp_ns: Time of the plan [ns].
        start_ns: Time at which the scenario started [ns].
        positions: Planned CoM positions [m], (N, 2).
        velocities: Their velocities [m/s], (N, 2).
        yaws: Planned headings [rad], not wrapped, (N,).
        yaw_rates: Their rates [rad/s], (N,).
        frozen: Plans that wait for their robot after an alarm, (N,).
    """

    stamp_ns: int
    start_ns: int
    positions: Array
    velocities: Array
    yaws: Array
    yaw_rates: Array
    frozen: NDArray[np.bool_]


def coasted(state: CoordinationState, stamp_ns: int, longest_ns: int) -> CoordinationState:
    """Carry the plan over missed ticks at constant velocity.

    Args:
        state: The plan.
        stamp_ns: Time to go to [ns]; nothing moves if it isn't later.
        longest_ns: Longest time over which it moves [ns]: robots that hear nothing
            brake, and the plan shouldn't run away from them.
    """
    if stamp_ns == state.stamp_ns:
        return state
    dt = min(max(stamp_ns - state.stamp_ns, 0), longest_ns) / NS_PER_S
    return replace(
        state,
        stamp_ns=stamp_ns,
        positions=state.positions + dt * state.velocities,
        yaws=state.yaws + dt * state.yaw_rates,
    )


def advanced(
    state: CoordinationState, u: Array, yaw_acceleration: Array, period_ns: int
) -> CoordinationState:
    """Integrate one period exactly, the inputs held.

    phi+ = phi + dt v + dt^2/2 u and v+ = v + dt u.

    Args:
        state: The plan.
        u: Inputs [m/s^2], (N, 2).
        yaw_acceleration: [rad/s^2], (N,); it acts on the rate of the next period.
        period_ns: Period [ns].
    """
    dt = period_ns / NS_PER_S
    return CoordinationState(
        state.stamp_ns + period_ns,
        state.start_ns,
        state.positions + dt * state.velocities + (0.5 * dt * dt) * u,
        state.velocities + dt * u,
        state.yaws + dt * state.yaw_rates,
        state.yaw_rates + dt * yaw_acceleration,
        state.frozen,
    )


def motions(state: CoordinationState, u: Array) -> tuple[PlannedMotion, ...]:
    """Return the plan as one motion a robot, at the stamp of the state."""
    rows = zip(
        state.positions,
        state.velocities,
        u,
        state.yaws.tolist(),
        state.yaw_rates.tolist(),
        strict=True,
    )
    return tuple(PlannedMotion(state.stamp_ns, *row) for row in rows)


def input_limits(
    velocities: Array, limit: float, speed_limit: float, dt: float
) -> tuple[Array, Array]:
    """Return the hard limits of the inputs, the speed limit one period ahead included.

    max(-limit, (-speed_limit - v) / dt) <= u <= min(limit, (speed_limit - v) / dt). Above the speed
    limit the robot brakes as hard as it can, so that the limits never cross.

    Args:
        velocities: Planned velocities [m/s], (N, 2).
        limit: Largest input per axis [m/s^2].
        speed_limit: Largest speed per axis [m/s].
        dt: Period [s].

    Returns:
        Lower and upper limits [m/s^2], (2 N,) each.
    """
    v = velocities.reshape(-1)
    lower = np.minimum(np.maximum((-speed_limit - v) / dt, -limit), limit)
    upper = np.minimum(np.maximum((speed_limit - v) / dt, -limit), limit)
    return lower, upper
