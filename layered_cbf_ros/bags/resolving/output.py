"""Writes re-solved messages as a bag, laid out as the run's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from layered_cbf_ros.bags.resolving.rows import SERIES, Content, Row
from layered_cbf_ros.bags.resolving.run_setup import RunSetup
from layered_cbf_ros.bags.resolving.ticks import Tick
from layered_cbf_ros.bags.storage.metadata import qos_yaml
from layered_cbf_ros.bags.storage.presets import Storage
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.tracks import PLANE
from layered_cbf_ros.node_topics import PLAN, SCENARIO, TRACKS
from layered_cbf_ros.scenario_file import to_json

BATCH = 20  # ticks told in one message, as by the coordinator
TYPES = {
    PLAN: 'trajectory_msgs/msg/MultiDOFJointTrajectory',
    TRACKS: 'nav_msgs/msg/Odometry',
    **dict.fromkeys(SERIES, 'trajectory_msgs/msg/JointTrajectory'),
}
JOINT_STATE, STRING = 'sensor_msgs/msg/JointState', 'std_msgs/msg/String'


class OutputBag:
    """Takes all answers; what they are about is when their tick was recorded."""

    topics: frozenset[str] = frozenset()

    def __init__(self, path: Path, source: Path, setup: RunSetup, force: bool) -> None:
        """Create the bag, with the scenario in it.

        Args:
            path: Its folder.
            source: The bag that is re-solved, which is never overwritten.
            setup: Of the run, with other parameters in it if that was asked.
            force: Replace a bag that is there.

        Raises:
            BagError: If it can't be written there.
        """
        if path.suffix == '.mcap':
            raise BagError(f'--output {path} must be the folder of a bag; leave out .mcap')
        if _are_nested(path.resolve(), source.resolve()):
            raise BagError(f'--output {path} is where the recording is; choose another folder')
        self._store: Any = get_typestore(Stores.ROS2_JAZZY)
        self._bag = BagWriter(path, storage=Storage('lz4', force=force))
        self._ids: dict[str, int] = {}
        self._batches: dict[str, list[Row]] = {}
        self._setup = setup
        self._log_ns: int | None = None

    def recorded(self, record: Record) -> None:
        """Do nothing: what was recorded is in the other bag."""

    def resolved(self, topic: str, content: Content, tick: Tick) -> None:
        """Write an answer, the slow ones in batches."""
        if self._log_ns is None:
            self._write_scenario(tick.record.log_time_ns)
        self._log_ns = tick.record.log_time_ns
        if isinstance(content, bytes):
            self._write(topic, content, tick.stamp_ns)
        elif topic == TRACKS:
            self._write(topic, self._encoded(TRACKS, self._odometry(content)), tick.stamp_ns)
        else:
            batch = self._batches.setdefault(topic, [])
            if batch and batch[0].names != content.names:
                self._write_batch(topic)
            self._batches[topic].append(content)
            if len(self._batches[topic]) == BATCH:
                self._write_batch(topic)

    def close(self) -> None:
        """Write the batches that aren't full, and the bag's end."""
        for topic in self._batches:
            self._write_batch(topic)
        self._bag.close()

    def _write(self, topic: str, data: bytes, stamp_ns: int, latched: bool = False) -> None:
        if topic not in self._ids:
            qos = qos_yaml(durability='transient_local' if latched else 'volatile')
            kind = STRING if topic == SCENARIO else TYPES.get(topic, JOINT_STATE)
            self._ids[topic] = self._bag.add_topic(topic, kind, qos)
        self._bag.write(self._ids[topic], data, self._log_ns or 0, stamp_ns)

    def _write_scenario(self, log_ns: int) -> None:
        self._log_ns = log_ns
        message = self._store.types[STRING](data=to_json(self._setup.changed_scenario))
        data = bytes(self._store.serialize_cdr(message, STRING))
        self._write(SCENARIO, data, log_ns, latched=True)

    def _write_batch(self, topic: str) -> None:
        batch, self._batches[topic] = self._batches[topic], []
        if batch:
            self._write(topic, self._encoded(topic, self._series(batch)), batch[0].stamp_ns)

    def _encoded(self, topic: str, message: Any) -> bytes:
        return bytes(self._store.serialize_cdr(message, TYPES[topic]))

    def _header(self, stamp_ns: int) -> Any:
        types = self._store.types
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        stamp = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
        return types['std_msgs/msg/Header'](stamp=stamp, frame_id='world')

    def _series(self, batch: list[Row]) -> Any:
        types, begin_ns = self._store.types, batch[0].stamp_ns
        points = []
        for row in batch:
            seconds, nanoseconds = divmod(row.stamp_ns - begin_ns, NS_PER_S)
            after = types['builtin_interfaces/msg/Duration'](sec=seconds, nanosec=nanoseconds)
            points.append(types['trajectory_msgs/msg/JointTrajectoryPoint'](*row.values, after))
        return types['trajectory_msgs/msg/JointTrajectory'](
            self._header(begin_ns), list(batch[0].names), points
        )

    def _odometry(self, row: Row) -> Any:
        types, values = self._store.types, row.values[:, 0]
        vector, point = types['geometry_msgs/msg/Vector3'], types['geometry_msgs/msg/Point']
        pose = types['geometry_msgs/msg/Pose'](
            point(values[0], values[1], 0.0),
            types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        )
        twist = types['geometry_msgs/msg/Twist'](
            vector(values[2], values[3], 0.0), vector(0.0, 0.0, 0.0)
        )
        covariances = [np.zeros((6, 6)) for _ in range(2)]
        for covariance, block in zip(covariances, (values[4:8], values[8:12]), strict=True):
            covariance[PLANE] = block.reshape(2, 2)
        return types['nav_msgs/msg/Odometry'](
            self._header(row.stamp_ns),
            row.part,
            types['geometry_msgs/msg/PoseWithCovariance'](pose, covariances[0].ravel()),
            types['geometry_msgs/msg/TwistWithCovariance'](twist, covariances[1].ravel()),
        )


def _are_nested(a: Path, b: Path) -> bool:
    """Tell whether one path holds the other."""
    return a == b or a in b.parents or b in a.parents
