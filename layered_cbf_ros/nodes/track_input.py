"""The tracks of one stamp: an Odometry each, and a PoseArray that tells how many."""

from __future__ import annotations

import time
from operator import itemgetter

from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message

from layered_cbf_ros.interfaces import Track
from layered_cbf_ros.messages.standard import points_from, track_from
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.scenario import Scenario

SENDER = '/obstacle_tracker'


class TrackInput:
    """Collects tracks; in real time also those of a tracker that sends Odometry only."""

    def __init__(self, node: GraphNode, scenario: Scenario) -> None:
        self._node = node
        self._radius = max(obstacle.radius for obstacle in scenario.obstacles)
        self._odometry = node.reader(Odometry, '/obstacles/tracks')
        self._counts = node.input(
            PoseArray,
            '/obstacles/tracked',
            node.rules.tracks,
            lambda data: len(points_from(deserialize_message(data, PoseArray))),
            SENDER,
        )
        self._tracks: dict[str, Track] = {}
        self._waiting: dict[tuple[int, str], Track] = {}

    def at(self, tick_ns: int) -> tuple[Track, ...]:
        """Return the tracks that a tick uses."""
        if self._node.lockstep:
            self._complete(tick_ns)
        else:
            self._refresh(tick_ns)
        return tuple(self._tracks.values())

    def _complete(self, tick_ns: int) -> None:
        """Wait for exactly the tracks of the wanted stamp, as many as were announced."""
        wanted = self._node.rules.tracks.wanted(tick_ns)
        count = self._counts.at(tick_ns)
        if wanted is None or count is None:
            return
        give_up_ns = time.monotonic_ns() + round(self._node.timing.patience * 1e9)
        while len(due := self._due(wanted)) < count:
            track = self._take()
            if track is None:
                self._node.wait(self._odometry, give_up_ns, SENDER)
            else:  # one that was sent again takes its own place
                self._waiting[track.stamp_ns, track.name] = track
        self._tracks = {track.name: track for track in due}
        self._waiting = {key: track for key, track in self._waiting.items() if key[0] >= wanted}

    def _due(self, stamp_ns: int) -> list[Track]:
        """Return the tracks of a stamp in an order that does not depend on their way."""
        return [
            track
            for (stamp, _), track in sorted(self._waiting.items(), key=itemgetter(0))
            if stamp == stamp_ns
        ]

    def _refresh(self, tick_ns: int) -> None:
        """Keep the newest of each name; forget what was lost for too long."""
        while (track := self._take()) is not None:
            self._tracks[track.name] = track
        limit_ns = self._node.rules.tracks.age_limit_ns
        old = [n for n, track in self._tracks.items() if tick_ns - track.stamp_ns > limit_ns]
        for name in old:
            del self._tracks[name]

    def _take(self) -> Track | None:
        while (data := self._odometry.take()) is not None:
            track = self._node.accept(self._decode, data)
            if track is not None:
                return track
        return None

    def _decode(self, data: bytes) -> Track:
        return track_from(deserialize_message(data, Odometry), self._radius)
