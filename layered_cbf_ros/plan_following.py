"""What a robot follows: its plan, or, when the coordinator is silent, a stop."""

from __future__ import annotations

from layered_cbf_ros.interfaces import Array, PlannedMotion


class PlanFollower:
    """Follows the newest plan; brakes along it when there is none.

    The controllers of a robot each have one. They see the same plans and so agree
    on the motion without talking to each other.
    """

    def __init__(self, deceleration: float) -> None:
        self._deceleration = deceleration
        self._last: PlannedMotion | None = None

    def follow(
        self, stamp_ns: int, plan: PlannedMotion | None, position: Array, yaw: float
    ) -> tuple[PlannedMotion, bool]:
        """Return the motion at a stamp, and whether the robot is to halt.

        Args:
            stamp_ns: Time of the tick [ns].
            plan: The plan in force, None if the coordinator is silent.
            position: CoM position in the world plane [m], (2,): where the robot
                stands until the first plan.
            yaw: Its heading [rad].
        """
        if plan is not None:
            self._last = plan
            return plan.at(stamp_ns), False
        if self._last is None:
            self._last = PlannedMotion.standing(stamp_ns, position, yaw)
        return self._last.braked(stamp_ns, self._deceleration), True
