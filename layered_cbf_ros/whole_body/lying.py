"""When a robot lies damped, and when it may stand up again.

A robot that lies must not jump up, whatever plan it hears: it stands up only along a
plan that begins where it lies and climbs without a step.
"""

from __future__ import annotations

import math

from layered_cbf_ros.interfaces import Array, PlannedMotion
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters


def is_left_damped(
    damped: bool,
    before: PlannedMotion | None,
    motion: PlannedMotion,
    com_height: float,
    rotation: Array,
    parameters: WholeBodyParameters,
) -> bool:
    """Tell whether a robot's joints are only to be damped.

    One on its feet is given up when it tilts too far, when its plan has sat it down or
    leaps up, or when it is much lower than planned. One that lies stays damped until
    it is level, and a plan climbs from where it is.

    Args:
        damped: Whether it was damped a tick ago.
        before: The motion of a tick ago; None at the first tick.
        motion: The motion that it is to follow.
        com_height: Measured height of its CoM over the ground [m].
        rotation: Orientation, base to world, (3, 3).
        parameters: Thresholds.
    """
    p = parameters
    below = p.com_height + motion.height - com_height
    climbs = motion.vertical_velocity > 0.0
    leaps = before is not None and motion.height - before.height > p.height_step
    if leaps or not rotation[2, 2] > math.cos(math.radians(p.damping_tilt)):
        return True
    if damped:
        return not (climbs and below < p.rise_gap)
    has_sat_down = p.com_height + motion.height < p.sit_height and not climbs
    return has_sat_down or not below < p.fall_gap
