"""The MPC's plan for the feet as named entries of a JointState.

`FL_foot_x` .. `RR_foot_z`: position is the foothold, effort the force, in the world.
`FL_foot_phase` ..: position is the done part of the swing, velocity its rate.
`com_x` .. `com_z`: predicted CoM position and velocity in the world.
`rotation_x` .. `rotation_z`: predicted rotation vector from the present orientation,
and angular velocity in the base frame.
"""

from __future__ import annotations

import numpy as np

from layered_cbf_ros.interfaces import LEGS, GroundForcePlan
from layered_cbf_ros.messages.joint_state import JointStateReader, JointStateWriter

AXES = ('x', 'y', 'z')
NAMES = (
    *(f'{leg}_foot_{axis}' for leg in LEGS for axis in AXES),
    *(f'{leg}_foot_phase' for leg in LEGS),
    *(f'com_{axis}' for axis in AXES),
    *(f'rotation_{axis}' for axis in AXES),
)
FEET, PHASES, COM, ROTATION = slice(0, 12), slice(12, 16), slice(16, 19), slice(19, 22)


class GroundForceWriter:
    """Encodes plans."""

    def __init__(self) -> None:
        self._writer = JointStateWriter(NAMES, 'world')
        self._position, self._velocity, self._effort = (np.zeros(len(NAMES)) for _ in range(3))

    def encode(self, plan: GroundForcePlan) -> bytes:
        """Return the message for a plan."""
        self._position[FEET] = plan.footholds.ravel()
        self._effort[FEET] = plan.forces.ravel()
        self._position[PHASES] = plan.swing_phase
        self._velocity[PHASES] = plan.swing_rate
        self._position[COM], self._velocity[COM] = plan.predicted[:3], plan.predicted[3:6]
        self._position[ROTATION], self._velocity[ROTATION] = plan.predicted[6:9], plan.predicted[9:]
        return self._writer.encode(plan.stamp_ns, self._position, self._velocity, self._effort)


class GroundForceReader:
    """Decodes plans."""

    def __init__(self) -> None:
        self._reader = JointStateReader(NAMES)

    def read(self, data: bytes) -> GroundForcePlan:
        """Return the plan.

        Raises:
            MessageError: If the message is malformed, lacks an entry or isn't finite.
        """
        stamp_ns, (position, velocity, effort) = self._reader.read(data)
        predicted = np.concatenate(
            (position[COM], velocity[COM], position[ROTATION], velocity[ROTATION])
        )
        return GroundForcePlan(
            stamp_ns,
            effort[FEET].reshape(4, 3),
            position[FEET].reshape(4, 3),
            position[PHASES],
            velocity[PHASES],
            predicted,
        )
