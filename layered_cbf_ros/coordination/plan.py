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
        sitting: How far each robot has sat down after an emergency stop: 0 it stands,
            1 it lies, (N,).
        sitting_rate: Its rate [1/s], (N,).
    """

    stamp_ns: int
    start_ns: int
    positions: Array
    velocities: Array
    yaws: Array
    yaw_rates: Array
    frozen: NDArray[np.bool_]
    sitting: Array
    sitting_rate: Array


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
        np.minimum(np.maximum(state.sitting + dt * state.sitting_rate, 0.0), 1.0),
        state.sitting_rate,
    )


def seated(
    state: CoordinationState, stopped: bool, at_rest: float, sit_time: float
) -> CoordinationState:
    """Set how fast each robot sits down, or stands up again.

    Args:
        state: The plan.
        stopped: Whether the emergency stop is latched.
        at_rest: Planned speed below which a stopped robot begins to sit down [m/s].
        sit_time: Time that it takes [s].
    """
    if not stopped and not state.sitting.any():
        return state if not state.sitting_rate.any() else _sitting_at(state, 0.0)
    slow = np.abs(state.velocities).max(axis=1) < at_rest
    down = (state.sitting < 1.0) & (slow | (state.sitting > 0.0))
    rate = down / sit_time if stopped else (state.sitting > 0.0) / -sit_time
    return _sitting_at(state, rate)


def _sitting_at(state: CoordinationState, rate: Array | float) -> CoordinationState:
    return replace(state, sitting_rate=np.zeros_like(state.sitting) + rate)


def motions(
    state: CoordinationState, u: Array, sit_depth: float = 0.0
) -> tuple[PlannedMotion, ...]:
    """Return the plan as one motion a robot, at the stamp of the state.

    The height of a robot that sits down by s in [0, 1] is -sit_depth s^2 (3 - 2 s).

    Args:
        state: The plan.
        u: Inputs [m/s^2], (N, 2).
        sit_depth: How far the CoM goes down [m].
    """
    s = state.sitting
    height = 0.0 - sit_depth * s * s * (3.0 - 2.0 * s)  # standing it isn't -0.0
    climb = 0.0 - 6.0 * sit_depth * s * (1.0 - s) * state.sitting_rate
    rows = zip(
        state.positions,
        state.velocities,
        u,
        state.yaws.tolist(),
        state.yaw_rates.tolist(),
        height.tolist(),
        climb.tolist(),
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
