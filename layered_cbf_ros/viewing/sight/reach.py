"""Where the coordinator takes a robot to be able to go within its horizon."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np

from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.reachable_sets import agent_reach
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.parameters import from_mapping
from layered_cbf_ros.scenario import Scenario

DIRECTIONS = 36
"""Of the ball that is drawn; between two of them it is too small by 0.4 % at most."""

STEPS = 12
"""Of the path that is drawn."""


def reach_ball(
    position: Array,
    velocity: Array,
    target: Array,
    is_held: bool,
    parameters: CoordinatorParameters,
) -> Array:
    """Return the smallest ball around a robot that holds its reachable set (paper eq. (13)).

    Args:
        position: Planned position in the world [m], (2,).
        velocity: Its velocity [m/s], (2,).
        target: Desired velocity in the world [m/s], (2,).
        is_held: Whether it can't obey: then only its velocity is known.
        parameters: Horizon, gain and limit of the law.

    Returns:
        Centre and radius [m], (3,).
    """
    p = parameters
    if is_held:
        return np.array([*position, p.horizon * math.hypot(*velocity)])
    angles = np.arange(DIRECTIONS) * (math.tau / DIRECTIONS)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    velocities, targets = (np.tile(v, (DIRECTIONS, 1)) for v in (velocity, target))
    reach = agent_reach(directions, velocities, targets, p.horizon, p.beta[1], p.acceleration_limit)
    return np.array([*position, reach.max()])


def path_ahead(
    position: Array, velocity: Array, target: Array, parameters: CoordinatorParameters
) -> Array:
    """Return where a robot would be within the horizon if nothing came in its way.

    It follows the law u = gain (target - v), |u| within its limit (paper eq. (11)).

    Args:
        position, velocity, target, parameters: As in reach_ball.

    Returns:
        Points in the world plane [m], (STEPS + 1, 2), the first where it is.
    """
    p = parameters
    dt = p.horizon / STEPS
    points, v = [position], velocity
    for _ in range(STEPS):
        error = target - v
        gain = min(p.beta[1], p.acceleration_limit / max(math.hypot(*error), 1e-9))
        following = v + (1.0 - math.exp(-gain * dt)) * error
        points.append(points[-1] + 0.5 * dt * (v + following))
        v = following
    return np.array(points)


def coordinator_parameters(scenario: Scenario) -> CoordinatorParameters:
    """Return what a run's coordinator was set up with, as far as its scenario tells.

    A supervisor's scenario has every parameter; one of another version may have others.
    """
    given = scenario.parameters.get('coordinator', {})
    known = {field.name for field in fields(CoordinatorParameters)}
    return from_mapping(CoordinatorParameters, {k: v for k, v in given.items() if k in known})
