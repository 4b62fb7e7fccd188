"""The tracks of one stamp: an Odometry each, and a PoseArray that tells how many."""

from __future__ import annotations

from operator import itemgetter

from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry

from layered_cbf_ros.interfaces import NS_PER_S, Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.standard import points_from, track_from
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.transport import TRACK_DEPTH, decoded
from layered_cbf_ros.scenario import Scenario

SENDER = '/obstacle_tracker'
FUTURE_NS = NS_PER_S // 10  # a stamp farther ahead is wrong
GONE_NS = NS_PER_S // 2  # a track that its tracker leaves out for so long is gone
FORGOTTEN_NS = 60 * NS_PER_S  # a track that nobody speaks of any more


def count_points(data: bytes) -> int:
    """Return how many tracks a serialised PoseArray announces."""
    return len(points_from(decoded(data, PoseArray)))


class TrackInput:
    """Collects tracks; in real time also those of a tracker that sends Odometry only."""

    def __init__(self, node: GraphNode, scenario: Scenario) -> None:
        self._node = node
        self._radius = max(obstacle.radius for obstacle in scenario.obstacles)
        self._odometry = node.reader(Odometry, '/obstacles/tracks', TRACK_DEPTH)
        self._announcements = node.reader(PoseArray, '/obstacles/tracked')
        self._counts = Input(node, self._announcements, node.rules.tracks, count_points, SENDER)
        self._announced_ns = 0
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
        give_up_ns = self._node.begin_wait()
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
        """Keep the newest of each name, until the tracker goes on without it.

        A track that is only silent stays: its reachable set grows with its age.
        """
        while (track := self._take()) is not None:
            old = self._tracks.get(track.name)
            if track.stamp_ns > tick_ns + FUTURE_NS:
                self._node.statistics.reject(f"track '{track.name}' has a stamp in the future")
            elif old is None or track.stamp_ns >= old.stamp_ns:
                self._tracks[track.name] = track
        while (data := self._announcements.take()) is not None:
            stamp_ns = self._node.accept(stamp_of, data)
            if stamp_ns is not None and stamp_ns <= tick_ns + FUTURE_NS:
                self._announced_ns = max(self._announced_ns, stamp_ns)
        gone_ns = max(self._announced_ns - GONE_NS, tick_ns - FORGOTTEN_NS)
        for name in [n for n, track in self._tracks.items() if track.stamp_ns < gone_ns]:
            del self._tracks[name]

    def _take(self) -> Track | None:
        while (data := self._odometry.take()) is not None:
            track = self._node.accept(self._decode, data)
            if track is not None:
                return track
        return None

    def _decode(self, data: bytes) -> Track:
        return track_from(decoded(data, Odometry), self._radius)
