"""The tracks of one stamp: an Odometry each, and a PoseArray that tells how many."""

from __future__ import annotations

from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry

from layered_cbf_ros.interfaces import Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import points_from, track_from
from layered_cbf_ros.node_topics import TRACKED, TRACKS
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.transport import TRACK_DEPTH, decoded
from layered_cbf_ros.perception.known_tracks import NewestTracks, TracksByStamp, track_radius
from layered_cbf_ros.scenario import Scenario

SENDER = '/obstacle_tracker'


def count_points(data: bytes) -> int:
    """Return how many tracks a serialised PoseArray announces."""
    return len(points_from(decoded(data, PoseArray)))


class TrackInput:
    """Collects tracks; in real time also those of a tracker that sends Odometry only."""

    def __init__(self, node: GraphNode, scenario: Scenario) -> None:
        self._node = node
        self._radius = track_radius(scenario)
        self._odometry = node.reader(Odometry, TRACKS, TRACK_DEPTH)
        self._announcements = node.reader(PoseArray, TRACKED)
        self._counts = Input(node, self._announcements, node.rules.tracks, count_points, SENDER)
        self._by_stamp, self._newest = TracksByStamp(), NewestTracks()
        self._complete: tuple[Track, ...] = ()

    def at(self, tick_ns: int) -> tuple[Track, ...]:
        """Return the tracks that a tick uses."""
        if self._node.lockstep:
            self._wait_for_all(tick_ns)
            return self._complete
        self._take_all(tick_ns)
        return self._newest.at(tick_ns)

    def _wait_for_all(self, tick_ns: int) -> None:
        """Wait for exactly the tracks of the wanted stamp, as many as were announced."""
        wanted = self._node.rules.tracks.wanted(tick_ns)
        count = self._counts.at(tick_ns)
        if wanted is None or count is None:
            return
        give_up_ns = self._node.begin_wait()
        while len(due := self._by_stamp.due(wanted)) < count:
            track = self._take()
            if track is None:
                self._node.wait(self._odometry, give_up_ns, SENDER)
            else:
                self._by_stamp.offer(track)
        self._complete = tuple(due)
        self._by_stamp.forget_before(wanted)

    def _take_all(self, tick_ns: int) -> None:
        """Take what has come, in real time."""
        while (track := self._take()) is not None:
            if not self._newest.offer(track, tick_ns):
                self._node.statistics.reject(f"track '{track.name}' has a stamp in the future")
        while (data := self._announcements.take()) is not None:
            stamp_ns = self._node.accept(stamp_of, data)
            if stamp_ns is not None:
                self._newest.announce(stamp_ns, tick_ns)

    def _take(self) -> Track | None:
        while (data := self._odometry.take()) is not None:
            track = self._node.accept(self._decode, data)
            if track is not None:
                return track
        return None

    def _decode(self, data: bytes) -> Track:
        return track_from(decoded(data, Odometry), self._radius)
