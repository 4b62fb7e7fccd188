"""Obstacle messages as core types; it doesn't matter who has decoded them, ROS or rosbags."""

from __future__ import annotations

from typing import Any

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S, Array, Track

PLANE = np.ix_((0, 1), (0, 1))
"""Rows of a 6 x 6 pose or twist covariance that hold x and y."""


def points_from(message: Any) -> Array:
    """Return the points of the plane that a PoseArray's poses stand at (n, 2) [m]."""
    return np.array([(p.position.x, p.position.y) for p in message.poses]).reshape(-1, 2)


def track_from(message: Any, radius: float) -> Track:
    """Return the track that an Odometry stands for.

    Args:
        message: Its twist is taken in the world frame.
        radius: Radius of the body, which the message does not tell [m].

    Raises:
        MessageError: If it is nameless or not finite.
    """
    if not message.child_frame_id:
        raise MessageError('track has no child_frame_id')
    stamp = message.header.stamp
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = message.pose.covariance.reshape(6, 6)[PLANE]
    covariance[2:, 2:] = message.twist.covariance.reshape(6, 6)[PLANE]
    track = Track(
        message.child_frame_id,
        int(stamp.sec) * NS_PER_S + int(stamp.nanosec),
        np.array([position.x, position.y]),
        np.array([velocity.x, velocity.y]),
        covariance,
        radius,
    )
    if not all(np.isfinite(a).all() for a in (track.position, track.velocity, covariance)):
        raise MessageError(f"track '{track.name}' has a value that is not finite")
    return track
