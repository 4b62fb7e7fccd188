"""obstacle_tracker: turns detections, which have no names, into tracks, which do."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from layered_cbf_ros.interfaces import Array, Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.standard import points, track_odometry
from layered_cbf_ros.messages.tracks import points_from
from layered_cbf_ros.node_topics import DETECTIONS, TRACKED, TRACKS
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.transport import TRACK_DEPTH, decoded
from layered_cbf_ros.perception.obstacle_tracker import ObstacleTracker
from layered_cbf_ros.perception.parameters import ObstacleTrackerParameters


def read_points(data: bytes) -> tuple[int, Array]:
    """Return stamp [ns] and points (n, 2) [m] of a serialised PoseArray."""
    return stamp_of(data), points_from(decoded(data, PoseArray))


class ObstacleTrackerNode(GraphNode):
    """Wires detections to the tracker and its tracks to the coordinator."""

    def __init__(self) -> None:
        super().__init__('obstacle_tracker')
        self._tracker = ObstacleTracker(declare(self, ObstacleTrackerParameters))
        self._detections = self.reader(PoseArray, DETECTIONS)
        self._tracks = self.writer(Odometry, TRACKS, kept=TRACK_DEPTH)
        self._tracked = self.writer(PoseArray, TRACKED)

    def run(self) -> None:
        """Update the tracks on every detection message, seen or empty."""
        self.become_ready()
        memory = self._tracker.start(0)
        every_ns = self.timing.detection_ns
        received = self.each(self._detections, every_ns) if self.lockstep else self._as_they_come()
        for data in received:
            detections = self.accept(read_points, data)
            if detections is None:
                continue
            begun_ns = time.perf_counter_ns()
            result = self._tracker.step(memory, *detections)
            memory = result.state
            self.statistics.rejected += result.rejected
            self._publish(memory.stamp_ns, result.tracks)
            self.statistics.tick(time.perf_counter_ns() - begun_ns)

    def _as_they_come(self) -> Iterator[bytes]:
        """Yield every message: the tracker itself knows what to do with a late one."""
        self.statistics.period_ns = self.timing.detection_ns
        while True:
            self.serve()
            data = self._detections.take()
            if data is None:
                self.wait(self._detections, None, '')
            else:
                self.statistics.begin(time.monotonic_ns())
                yield data

    def _publish(self, stamp_ns: int, tracks: Sequence[Track]) -> None:
        for track in tracks:
            self._tracks.publish(serialize_message(track_odometry(track)))
        centres = np.array([track.position for track in tracks]).reshape(-1, 2)
        self._tracked.publish(serialize_message(points(stamp_ns, centres)))


def main() -> None:
    """Run the node."""
    run_node(ObstacleTrackerNode)
