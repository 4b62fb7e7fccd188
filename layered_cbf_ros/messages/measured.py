"""What a robot's sensors read, as named entries of a JointState.

One message holds joints, IMU and feet: at 1 kHz it is the number of messages that costs.
"""

from __future__ import annotations

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import JOINT_NAMES, Measured
from layered_cbf_ros.messages.joint_state import JointStateReader, JointStateWriter
from layered_cbf_ros.messages.robot_state import FOOT_NAMES, QUATERNION_TOLERANCE

IMU_NAMES = (
    *('imu_qx', 'imu_qy', 'imu_qz', 'imu_qw'),
    *('imu_wx', 'imu_wy', 'imu_wz'),
    *('imu_ax', 'imu_ay', 'imu_az'),
)
MEASURED_NAMES = JOINT_NAMES + FOOT_NAMES + IMU_NAMES
_JOINTS, _FEET = slice(0, 12), slice(12, 16)
_ORIENTATION, _TURNING, _FORCE = slice(16, 20), slice(20, 23), slice(23, 26)


class MeasuredWriter:
    """Encodes what the sensors of one robot read.

    Joints have position, velocity and effort; feet their effort; the IMU's quaternion is
    in positions, its angular velocity in velocities, its specific force in efforts.
    """

    def __init__(self, robot: str) -> None:
        self._writer = JointStateWriter(MEASURED_NAMES, robot)
        self._values = np.zeros((3, len(MEASURED_NAMES)))

    def encode(self, measured: Measured) -> bytes:
        """Return the message."""
        values = self._values
        values[:, _JOINTS] = measured.joints
        values[2, _FEET] = measured.foot_forces
        values[0, _ORIENTATION] = measured.orientation
        values[1, _TURNING] = measured.angular_velocity
        values[2, _FORCE] = measured.specific_force
        return self._writer.encode(measured.stamp_ns, *values)


class MeasuredReader:
    """Reads such messages."""

    def __init__(self) -> None:
        self._reader = JointStateReader(MEASURED_NAMES)

    def read(self, data: bytes) -> Measured:
        """Return what the sensors read.

        Raises:
            MessageError: If the message lacks a value, is malformed or not finite.
        """
        stamp_ns, values = self._reader.read(data)
        orientation = values[0, _ORIENTATION]
        if abs(float(orientation @ orientation) - 1.0) > QUATERNION_TOLERANCE:
            raise MessageError("the IMU's orientation is no unit quaternion")
        return Measured(
            stamp_ns,
            values[:, _JOINTS],
            orientation,
            values[1, _TURNING],
            values[2, _FORCE],
            values[2, _FEET],
        )
