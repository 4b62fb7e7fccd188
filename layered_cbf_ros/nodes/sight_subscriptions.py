"""What the viewer hears of a live run: only the newest, and only when it is about to draw.

Every subscription is best effort and one deep, and taken by hand: what comes between two
frames is overwritten in the middleware and costs no Python. While nobody looks at the
page nothing but the scenario and the diagnostics are subscribed to.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import points_from, track_from
from layered_cbf_ros.node_topics import (
    BARRIERS,
    COMMANDS,
    DESIRED,
    DIAGNOSTICS,
    INTERVENTION,
    PLAN,
    SCENARIO,
    TRACKS,
    TRUTH,
)
from layered_cbf_ros.nodes.transport import Reader, decoded, latched, reliable
from layered_cbf_ros.perception.known_tracks import track_radius
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.viewing.sight.live import LiveSight

TRAJECTORIES = (BARRIERS, INTERVENTION, DESIRED, COMMANDS)
TRUTH_PATIENCE_S = 2.0
"""If nobody tells for so long where obstacles truly are, tracks are listened to [s]."""
TRACKS_AT_ONCE = 16


def newest_only(depth: int = 1) -> QoSProfile:
    """Return the quality of service of who wants the newest and asks for nothing again."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


class SightSubscriptions:
    """Feeds a LiveSight."""

    def __init__(self, node: Node, sight: LiveSight) -> None:
        self._node, self._sight = node, sight
        self._scenario = Reader(node, String, SCENARIO, latched())
        self._diagnostics = Reader(node, DiagnosticArray, DIAGNOSTICS, reliable())
        self._readers: dict[str, Reader] = {}
        self._others: dict[str, tuple[Reader, Callable[[bytes], None]]] = {}
        self._watched_since = 0.0

    def take(self, is_watched: bool, wants_forces: bool) -> None:
        """Take what is new.

        Args:
            is_watched: Whether anybody looks: without, the rest is not even received.
            wants_forces: Whether foot forces are shown.
        """
        self._take_scenario()
        while (data := self._diagnostics.take()) is not None:
            with contextlib.suppress(MessageError):
                message = decoded(data, DiagnosticArray)
                self._sight.take_diagnostics(message, time.monotonic())
        if self._sight.scenario is None:
            return
        if not is_watched:
            self._end_all()
            return
        self._follow(self._sight.scenario, wants_forces)
        for topic, reader in self._readers.items():
            data = reader.take()
            if data is not None:
                self._sight.take(topic, data)
        for reader, take in list(self._others.values()):
            while (data := reader.take()) is not None:
                with contextlib.suppress(MessageError):
                    take(data)

    def _take_scenario(self) -> None:
        while (data := self._scenario.take()) is not None:
            with contextlib.suppress(MessageError):
                text = decoded(data, String).data
                self._end_all()
                self._sight.take_scenario(text)

    def _follow(self, scenario: Scenario, wants_forces: bool) -> None:
        """Subscribe to what is shown, and to nothing else."""
        wanted = {
            topic
            for topic in self._sight.topics
            if wants_forces or not topic.endswith('/ground_forces')
        }
        for topic in self._readers.keys() - wanted:
            self._readers.pop(topic).end(self._node)
        for topic in wanted - self._readers.keys():
            self._readers[topic] = Reader(self._node, type_of(topic), topic, newest_only())
        if not scenario.obstacles:
            return
        if TRUTH not in self._others:
            self._watched_since = time.monotonic()
            reader = Reader(self._node, PoseArray, TRUTH, newest_only())
            self._others[TRUTH] = reader, self._take_truth
        is_late = time.monotonic() > self._watched_since + TRUTH_PATIENCE_S
        if is_late and not self._sight.has_truth and TRACKS not in self._others:
            radius = track_radius(scenario)
            reader = Reader(self._node, Odometry, TRACKS, newest_only(TRACKS_AT_ONCE))
            self._others[TRACKS] = (
                reader,
                lambda data: self._sight.take_track(track_from(decoded(data, Odometry), radius)),
            )

    def _take_truth(self, data: bytes) -> None:
        self._sight.take_truth(stamp_of(data), points_from(decoded(data, PoseArray)))

    def _end_all(self) -> None:
        """Hear nothing more of the bodies."""
        for reader in (*self._readers.values(), *(reader for reader, _ in self._others.values())):
            reader.end(self._node)
        self._readers, self._others = {}, {}


def type_of(topic: str) -> type:
    """Return the message type of a topic that LiveSight.take takes."""
    if topic == PLAN:
        return MultiDOFJointTrajectory
    if topic in TRAJECTORIES:
        return JointTrajectory
    return Odometry if topic.endswith('/odom') else JointState
