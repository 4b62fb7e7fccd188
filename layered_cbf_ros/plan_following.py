"""What a robot follows: its plan, or, when the coordinator is silent, a stop."""

from __future__ import annotations

from dataclasses import dataclass, replace

from layered_cbf_ros.interfaces import NS_PER_S, Array, PlannedMotion

SINK_SPEED = 0.1
"""How fast a robot goes on sitting down when the coordinator falls silent amid it [m/s]."""

LOWEST = -0.2
"""No A1 on its feet gets lower than that, relative to standing [m]."""


@dataclass(frozen=True, slots=True)
class Followed:
    """What a robot follows at one tick.

    Attributes:
        motion: The motion at the tick's stamp.
        halt: Whether the robot is to halt.
        last: The plan that counts until there is a newer one; for the next tick.
    """

    motion: PlannedMotion
    halt: bool
    last: PlannedMotion


def follow(
    last: PlannedMotion | None,
    stamp_ns: int,
    plan: PlannedMotion | None,
    position: Array,
    yaw: float,
    deceleration: float,
) -> Followed:
    """Follow the newest plan; brake along it when there is none.

    A robot that isn't at its full height by its last plan sits down then: it was told
    to, or it was not told that it may stay up.

    Both controllers of a robot do this. They see the same plans and so agree on the
    motion without talking to each other.

    Args:
        last: What the tick before returned; None at the first.
        stamp_ns: Time of the tick [ns].
        plan: The plan in force, None if the coordinator is silent.
        position: CoM position in the world plane [m], (2,): where the robot
            stands until the first plan.
        yaw: Its heading [rad].
        deceleration: Size of the braking acceleration [m/s^2].
    """
    if plan is not None:
        return Followed(plan.at(stamp_ns), False, plan)
    if last is None:
        last = PlannedMotion.standing(stamp_ns, position, yaw)
    motion = last.braked(stamp_ns, deceleration)
    return Followed(_sunk(motion, last) if last.height < 0.0 else motion, True, last)


def _sunk(motion: PlannedMotion, last: PlannedMotion) -> PlannedMotion:
    """Return a motion that goes down evenly from the height of the last plan."""
    elapsed = (motion.stamp_ns - last.stamp_ns) / NS_PER_S
    height = last.height - SINK_SPEED * elapsed
    if height <= LOWEST:
        return replace(motion, height=LOWEST, vertical_velocity=0.0)
    return replace(motion, height=height, vertical_velocity=-SINK_SPEED)
