"""Where the body of a robot that sits down should be over its feet."""

from __future__ import annotations

from dataclasses import replace

from layered_cbf_ros.interfaces import Array, PlannedMotion
from layered_cbf_ros.whole_body.virtual_constraints import BodyReference

CENTRED_AT = 0.1
"""So far below standing, the body is led by its feet alone, not by the plan [m]."""

SHIFT_BEGINS = 0.1
"""So far below standing, the body begins to move forwards over its feet [m]."""

SHIFT_PER_DEPTH = 1.2
"""How far the body moves forwards, for what it goes down beyond SHIFT_BEGINS."""


def sitting_body(body: BodyReference, motion: PlannedMotion, feet: Array) -> BodyReference:
    """Return the reference of a body that sits down so far that it lies on its belly.

    Knees fold until hip and toe are 9 cm apart, too far for the belly to touch the
    ground above the feet. So the body moves forwards as it goes down, and the toes end
    up behind the hips, as is the way of the A1.

    Args:
        body: As for a robot that stands where it is planned.
        motion: Planned motion; its height isn't positive.
        feet: Toe centres, all in stance, world [m], (4, 3).
    """
    depth = -motion.height
    part = min(depth / CENTRED_AT, 1.0)
    shift = SHIFT_PER_DEPTH * max(0.0, depth - SHIFT_BEGINS)
    rate = -SHIFT_PER_DEPTH * motion.vertical_velocity if shift > 0.0 else 0.0
    ahead = body.rotation[:2, 0]
    com, velocity = body.com.copy(), body.com_velocity.copy()
    com[:2] += part * (feet[:, :2].mean(axis=0) + shift * ahead - com[:2])
    velocity[:2] += rate * ahead
    return replace(body, com=com, com_velocity=velocity)
