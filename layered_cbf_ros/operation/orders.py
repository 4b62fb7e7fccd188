"""What the desk asks of every robot at one tick: velocities that grow no faster than allowed."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.interfaces import NS_PER_S, VelocityCommand
from layered_cbf_ros.operation.desk import Desk, Now
from layered_cbf_ros.operation.parameters import JoystickParameters

STILL = VelocityCommand(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Orders:
    """What is asked at one tick.

    Attributes:
        stamp_ns: Stamp of the tick [ns].
        commands: Of each robot, None for one that follows its own goal.
        stopped: The emergency stop.
    """

    stamp_ns: int
    commands: tuple[VelocityCommand | None, ...]
    stopped: bool = False

    @property
    def is_empty(self) -> bool:
        """Tell whether nothing is asked of anybody."""
        return not self.stopped and not any(self.commands)


def no_orders(stamp_ns: int, robots: int) -> Orders:
    """Return the orders of a desk at which nobody sits."""
    return Orders(stamp_ns, (None,) * robots)


def ordered(before: Orders, desk: Desk, now: Now, parameters: JoystickParameters) -> Orders:
    """Return the orders of a tick.

    A velocity grows by at most its rate limit; it falls to zero at once when the
    dead-man button is let go, or a planner is silent: the plan brakes anyway.

    Args:
        before: The orders of the last tick.
        desk: Who asks for what; a silent owner is released already.
        now: The tick.
        parameters: Limits and time-outs.
    """
    p, dt = parameters, (now.run_ns - before.stamp_ns) / NS_PER_S
    steps = p.linear_rate_limit * dt, p.angular_rate_limit * dt
    commands = tuple(
        _grown(last, _wish(robot, desk, now, p), steps)
        for robot, last in enumerate(before.commands)
    )
    return Orders(now.run_ns, commands, desk.stopped)


def _wish(
    robot: int, desk: Desk, now: Now, parameters: JoystickParameters
) -> VelocityCommand | None:
    """Return what is asked of a robot; the operator goes before a planner."""
    if robot in desk.steered:
        if not desk.owner or desk.stopped:
            return STILL
        hands = desk.sources[desk.owner].hands
        leader = desk.steered[0] if desk.formation else None
        return VelocityCommand(hands.x, hands.y, hands.yaw_rate, leader)
    wish = desk.planned.get(robot)
    if wish is None:
        return None
    if now.wall_ns - wish.heard_ns > parameters.cmd_vel_timeout * NS_PER_S or desk.stopped:
        return STILL
    return VelocityCommand(wish.x, wish.y, wish.yaw_rate)


def _grown(
    last: VelocityCommand | None, wish: VelocityCommand | None, steps: tuple[float, float]
) -> VelocityCommand | None:
    """Return the wish, no farther from the last command than one step where it grows."""
    if wish is None or wish in (STILL, last):
        return wish
    last = last or STILL
    linear, angular = steps
    return VelocityCommand(
        _towards(last.x, wish.x, linear),
        _towards(last.y, wish.y, linear),
        _towards(last.yaw_rate, wish.yaw_rate, angular),
        wish.leader,
    )


def _towards(value: float, goal: float, step: float) -> float:
    """Go to a goal, at most one step of growth; through zero without a limit."""
    start = value if value * goal > 0.0 else 0.0
    return goal if abs(goal) <= abs(start) + step else start + (step if goal > 0.0 else -step)
