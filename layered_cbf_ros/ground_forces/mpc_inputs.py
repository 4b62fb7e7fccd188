"""What the ground-force MPC is told at one tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import Array, PlannedMotion


@dataclass(frozen=True, slots=True)
class MpcInputs:
    """What is measured and wanted at one stamp.

    Attributes:
        stamp_ns: Stamp of the measured state [ns].
        position: CoM position, world [m], (3,).
        velocity: CoM velocity, world [m/s], (3,).
        rotation: Orientation, base to world, (3, 3).
        angular_velocity: Base frame [rad/s], (3,).
        feet: Centres of the toe spheres, world [m], (4, 3).
        motion: The safe motion to follow; of any stamp, it is extrapolated.
        height: Height of the CoM above the ground when the robot stands [m]; the motion
            tells where it is to be relative to that.
        halt: Whether to brake along the motion, finish the swing and stand.
    """

    stamp_ns: int
    position: Array
    velocity: Array
    rotation: Array
    angular_velocity: Array
    feet: Array
    motion: PlannedMotion
    height: float
    halt: bool = False

    def is_finite(self) -> bool:
        """Tell whether every number is one."""
        motion = self.motion
        body = (self.position, self.velocity, self.rotation, self.angular_velocity, self.feet)
        wanted = (motion.position, motion.velocity, motion.acceleration)
        numbers = (motion.yaw, motion.yaw_rate, motion.height, motion.vertical_velocity)
        together = np.concatenate((*body, *wanted, numbers, self.height), axis=None)
        return bool(np.isfinite(together).all())
