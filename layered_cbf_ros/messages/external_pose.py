"""geometry_msgs/PoseStamped of motion capture: where a robot is seen from outside."""

from __future__ import annotations

import math

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.messages.cdr import CdrReader, require_finite, stamp_of
from layered_cbf_ros.messages.robot_state import QUATERNION_TOLERANCE
from layered_cbf_ros.perception.external_pose import ExternalPose


class ExternalPoseReader:
    """Reads the poses of one robot's base."""

    def __init__(self, frame: str) -> None:
        """Begin.

        Args:
            frame: In which the poses must be.
        """
        self._frame = frame

    def read(self, data: bytes) -> ExternalPose:
        """Return the pose.

        Raises:
            MessageError: If it is in another frame, malformed or not finite.
        """
        reader = CdrReader(data)
        frame = reader.frame()
        if frame != self._frame:
            raise MessageError(
                f"external pose is in frame '{frame}'; send it in '{self._frame}', "
                'or set external_frame'
            )
        values = reader.fixed(7)
        require_finite(values, 'external pose')
        x, y, z, w = values[3:].tolist()
        if abs(x * x + y * y + z * z + w * w - 1.0) > QUATERNION_TOLERANCE:
            raise MessageError('external pose: orientation is no unit quaternion')
        yaw = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        return ExternalPose(stamp_of(data), values[:3], yaw)
