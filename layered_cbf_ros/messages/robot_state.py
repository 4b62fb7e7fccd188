"""The state of a robot as named entries of a JointState.

One message holds the joints, the base and the feet, of one robot or of all robots
of a simulated world: at 1 kHz it is the number of messages that costs, not their size.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import JOINT_NAMES, LEGS, RobotState
from layered_cbf_ros.messages.joint_state import JointStateReader, JointStateWriter

BASE_NAMES = ('base_x', 'base_y', 'base_z', 'base_qx', 'base_qy', 'base_qz', 'base_qw')
FOOT_NAMES = tuple(f'{leg}_foot' for leg in LEGS)
STATE_NAMES = BASE_NAMES + JOINT_NAMES + FOOT_NAMES
JOINTS = slice(len(BASE_NAMES), len(BASE_NAMES) + len(JOINT_NAMES))
FEET = slice(JOINTS.stop, JOINTS.stop + len(FOOT_NAMES))
# The quaternion has a place more than the angular velocity: that place stays zero.
VELOCITIES = np.delete(np.arange(JOINTS.stop), 6)
QUATERNION_TOLERANCE = 1e-3


def state_names(robot: str) -> list[str]:
    """Return the names of one robot's entries."""
    return [f'{robot}/{name}' for name in STATE_NAMES]


def base_names(robot: str) -> list[str]:
    """Return the names of the entries of a robot that is nothing but a base."""
    return [f'{robot}/{name}' for name in BASE_NAMES]


class StateWriter:
    """Encodes the states of a fixed list of robots in one message."""

    def __init__(self, robots: Sequence[str]) -> None:
        names = [name for robot in robots for name in state_names(robot)]
        self._writer = JointStateWriter(names, 'world')
        shape = (len(robots), len(STATE_NAMES))
        self._position, self._velocity, self._effort = (np.zeros(shape) for _ in range(3))

    def encode(self, states: Sequence[RobotState]) -> bytes:
        """Return the message for the states, in the order of the robots."""
        for i, state in enumerate(states):
            self._position[i, : JOINTS.stop] = state.configuration
            self._velocity[i, VELOCITIES] = state.velocity
            self._effort[i, JOINTS] = state.torques
            self._effort[i, FEET] = state.foot_forces
        return self._writer.encode(
            states[0].stamp_ns,
            self._position.ravel(),
            self._velocity.ravel(),
            self._effort.ravel(),
        )


class StateReader:
    """Picks one robot's state out of state messages."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._reader = JointStateReader(state_names(robot))

    def read(self, data: bytes) -> RobotState:
        """Return the state.

        Raises:
            MessageError: If the message lacks the robot, is malformed or not finite.
        """
        stamp_ns, values = self._reader.read(data)
        position, velocity, effort = values
        quaternion = position[3:7]
        if abs(float(quaternion @ quaternion) - 1.0) > QUATERNION_TOLERANCE:
            raise MessageError(f"state of '{self._robot}': base orientation is no unit quaternion")
        return RobotState(
            stamp_ns,
            position[: JOINTS.stop],
            velocity.take(VELOCITIES),
            effort[JOINTS],
            effort[FEET],
        )
