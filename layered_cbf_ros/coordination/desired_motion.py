"""What every robot would do if it were alone: k_d of the planner (paper eq. (21))."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import Array, VelocityCommand
from layered_cbf_ros.patterns import Pattern
from layered_cbf_ros.scenario import Desired, VelocityStep

Point = Sequence[float]
Twist = tuple[float, float, float]  # velocity x, y in the world [m/s], yaw rate [rad/s]


def desired_twist(
    desired: Desired,
    command: VelocityCommand | None,
    time: float,
    position: Point,
    yaw: float,
    others: Sequence[Point],
    parameters: CoordinatorParameters,
) -> Twist:
    """Return the desired twist of one robot; a command overrides its own wish.

    Robots on their way to a place keep right. Who is told a velocity wants just that.

    Args:
        desired: What the scenario says that it wants.
        command: A velocity asked for from outside, if any.
        time: Time since the start of the scenario [s].
        position: Planned position in the world [m], (2,).
        yaw: Planned heading [rad].
        others: Centres of all bodies in the world [m].
        parameters: Gains and limits.
    """
    p = parameters
    if command is None and desired.goal is not None:
        x, y = limited(*_towards(desired.goal, position, (0.0, 0.0), p), p.desired_speed)
        return kept_right((x, y, 0.0), position, others, p)
    if command is None and desired.pattern is not None:
        x, y = limited(*_along(desired.pattern, time, position, p), p.desired_speed)
        return kept_right((x, y, 0.0), position, others, p)
    wish = command or scripted(desired.velocity, time)
    in_world = command is None and desired.frame == 'world'
    x, y = rotated(wish.x, wish.y, 0.0 if in_world else yaw)
    x, y = limited(x, y, p.desired_speed)
    return x, y, min(max(wish.yaw_rate, -p.yaw_rate_limit), p.yaw_rate_limit)


def desired_input(velocity: Array, target: Array, parameters: CoordinatorParameters) -> Array:
    """Return k_d = beta_2 (target - v), its norm within the acceleration limit.

    With target = (beta_1 / beta_2) (goal - phi) this is the law of paper III-A,
    -beta_1 (phi - goal) - beta_2 v; the clipped target bounds the speed far away.

    Args:
        velocity: Planned velocities in the world [m/s], (N, 2).
        target: Desired velocities in the world [m/s], (N, 2).
        parameters: Gains and limits.

    Returns:
        Desired inputs in the world [m/s^2], (N, 2).
    """
    wish = parameters.beta[1] * (target - velocity)
    size = np.maximum(np.hypot(wish[:, 0], wish[:, 1]), parameters.acceleration_limit)
    limited_wish: Array = wish * (parameters.acceleration_limit / size)[:, None]
    return limited_wish


def kept_right(
    twist: Twist,
    position: Point,
    others: Sequence[Point],
    parameters: CoordinatorParameters,
) -> Twist:
    """Turn a robot's wish clockwise while somebody is ahead of it.

    Everybody keeps right, so that symmetric meetings resolve; the safety rows are
    untouched. Turned by less than 90 degrees, a wish still leads to its goal. The turn
    is keep_right_angle, faded in with the body's distance over the outermost metre of
    keep_right_range and with its bearing between 70 and 45 degrees.

    Args:
        twist: Desired twist in the world.
        position: Of the robot in the world [m].
        others: Centres of all bodies in the world [m]; the robot itself may be there.
        parameters: Range and angle.
    """
    p, (x, y, yaw_rate) = parameters, twist
    speed, share = math.hypot(x, y), 0.0
    if speed < 1e-9:
        return twist
    for other in others:
        dx, dy = other[0] - position[0], other[1] - position[1]
        distance = math.hypot(dx, dy)
        if 0.0 < distance < p.keep_right_range:
            cosine = (dx * x + dy * y) / (distance * speed)
            near = min(p.keep_right_range - distance, 1.0)
            share = max(share, near * min((cosine - 0.34) / 0.37, 1.0))
    turned_x, turned_y = rotated(x, y, -share * p.keep_right_angle)
    return turned_x, turned_y, yaw_rate


def rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    """Rotate a vector counterclockwise by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


def limited(x: float, y: float, limit: float) -> tuple[float, float]:
    """Shorten a vector to a limit, keeping its direction."""
    size = math.hypot(x, y)
    scale = limit / size if size > limit else 1.0
    return scale * x, scale * y


def scripted(script: tuple[VelocityStep, ...], time: float) -> VelocityStep:
    """Return the step of a velocity script that holds at a time [s]; first: rest."""
    current = VelocityStep(at=0.0)
    for step in script:
        if step.at > time:
            break
        current = step
    return current


def _towards(
    point: Point, position: Point, feed_forward: Point, parameters: CoordinatorParameters
) -> tuple[float, float]:
    """Return feed_forward + (beta_1 / beta_2) (point - position)."""
    ratio = parameters.beta[0] / parameters.beta[1]
    return (
        feed_forward[0] + ratio * (point[0] - position[0]),
        feed_forward[1] + ratio * (point[1] - position[1]),
    )


def _along(
    pattern: Pattern, time: float, position: Point, parameters: CoordinatorParameters
) -> tuple[float, float]:
    """Follow a pattern; its velocity is taken 1 / beta_2 early.

    beta_2 (v_ref(t + 1 / beta_2) - v) is beta_2 (v_ref - v) + a_ref to first order:
    the preview stands for the feed-forward of the reference's acceleration.
    """
    point, _ = pattern.at(time)
    _, ahead = pattern.at(time + 1.0 / parameters.beta[1])
    return _towards(point.tolist(), position, ahead.tolist(), parameters)
