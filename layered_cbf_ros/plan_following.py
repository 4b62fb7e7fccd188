"""What a robot follows: its plan, or, when the coordinator is silent, a stop."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.interfaces import Array, PlannedMotion


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
    return Followed(last.braked(stamp_ns, deceleration), True, last)
