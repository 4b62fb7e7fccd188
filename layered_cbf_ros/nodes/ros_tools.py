"""Publishes snapshots for tools that draw: MarkerArray, and TF where tf2_msgs is installed."""

from __future__ import annotations

from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.messages.standard import WORLD, header
from layered_cbf_ros.node_topics import MARKERS, TRANSFORMS
from layered_cbf_ros.nodes.message_types import message_class
from layered_cbf_ros.viewing.history import History
from layered_cbf_ros.viewing.links import Links
from layered_cbf_ros.viewing.markers import Mark, Numbers, marks
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

LIFETIME = Duration(sec=2)
"""So long tools show a marker that isn't sent again: until who sends has ended."""


class RosTools:
    """Publishes one snapshot after the other, to whoever listens.

    The rate is that of the calls: 30 Hz of wall time are enough for people.
    """

    def __init__(self, node: Node) -> None:
        """Create the publishers.

        Args:
            node: Whose they are.

        Raises:
            ParameterError: If the description of the robot is absent.
        """
        self._links, self._numbers, self._history = Links(), Numbers(), History()
        self._markers = node.create_publisher(MarkerArray, MARKERS, 10)
        self._transform_type = transform_message_type()
        self._transforms: Publisher | None = None
        if self._transform_type is not None:
            self._transforms = node.create_publisher(self._transform_type, TRANSFORMS, 100)

    def publish(self, snapshot: Snapshot) -> None:
        """Publish a snapshot."""
        self._history = self._history.after(snapshot)
        if self._markers.get_subscription_count():
            self._markers.publish(self.markers(snapshot))
        if self._transforms is not None and self._transforms.get_subscription_count():
            assert self._transform_type is not None
            self._transforms.publish(self._transform_type(transforms=self.transforms(snapshot)))

    def markers(self, snapshot: Snapshot) -> MarkerArray:
        """Return the markers of a snapshot, and the deletion of those that vanished."""
        message, shown = MarkerArray(), set()
        stamped = header(snapshot.stamp_ns)
        for mark in marks(snapshot, self._history, self._links):
            marker = _marker(mark, self._numbers.number(mark))
            marker.header = stamped
            shown.add((mark.group, marker.id))
            message.markers.append(marker)
        for group, number in sorted(self._numbers.vanished(shown)):
            message.markers.append(
                Marker(header=stamped, ns=group, id=number, action=Marker.DELETE)
            )
        return message

    def transforms(self, snapshot: Snapshot) -> list[TransformStamped]:
        """Return the frames of all robots with legs: `<r>/trunk` in the world, then its links."""
        found = []
        for robot in snapshot.robots:
            if not robot.has_legs:
                continue
            for pose in self._links.tree(robot.configuration):
                parent = f'{robot.name}/{pose.parent}' if pose.parent else WORLD
                stamped = TransformStamped(
                    header=header(snapshot.stamp_ns, parent),
                    child_frame_id=f'{robot.name}/{pose.link}',
                )
                p, q = stamped.transform.translation, stamped.transform.rotation
                p.x, p.y, p.z = pose.position.tolist()
                q.x, q.y, q.z, q.w = pose.quaternion.tolist()
                found.append(stamped)
        return found


def transform_message_type() -> Any | None:
    """Return tf2_msgs/TFMessage, None where that package isn't installed.

    It is part of every ROS installation, but not among the packages on PyPI.
    """
    try:
        return message_class('tf2_msgs/msg/TFMessage')
    except BagError:
        return None


def _marker(mark: Mark, number: int) -> Marker:
    """Return a mark as a message, but for its header."""
    marker = Marker(
        ns=mark.group, id=number, type=int(mark.kind), action=Marker.ADD, lifetime=LIFETIME,
        text=mark.text,
    )  # fmt: skip
    place, turn = marker.pose.position, marker.pose.orientation
    place.x, place.y, place.z = mark.position
    turn.x, turn.y, turn.z, turn.w = mark.quaternion
    marker.scale.x, marker.scale.y, marker.scale.z = mark.size
    red, green, blue, opacity = mark.colour
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=opacity)
    if mark.points is not None:
        marker.points = _points(mark.points)
    return marker


def _points(points: Array) -> list[Point]:
    rows = np.asarray(points, dtype=float).tolist()
    return [Point(x=x, y=y, z=z) for x, y, z in rows]
