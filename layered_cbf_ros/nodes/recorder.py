"""recorder: writes every topic of the run, byte for byte, into a bag."""

from __future__ import annotations

import importlib
import time
from pathlib import Path

from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import Header

from layered_cbf_ros.bags.recording.topic_counter import counter_for
from layered_cbf_ros.bags.storage.metadata import qos_yaml
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError, ParameterError, StopRequestedError
from layered_cbf_ros.messages.standard import header
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.transport import Reader

DEPTH = 2000  # beyond the window in which the simulator waits for the recorder
PAUSE_S = 0.005
DISCOVERY_NS = 50_000_000
FLUSH_NS = 1_000_000_000


class Recording:
    """One topic being recorded."""

    def __init__(self, reader: Reader, topic_id: int, type_name: str) -> None:
        self.reader = reader
        self.topic_id = topic_id
        self.counter = counter_for(type_name)


class RecorderNode(GraphNode):
    """Drains every topic a few hundred times a second."""

    def __init__(self) -> None:
        super().__init__('recorder')
        output = str(self.declare_parameter('output', '').value)
        if not output:
            raise ParameterError("recorder.output is ''; give the folder of the bag to write")
        self._bag = BagWriter(Path(output), compression='lz4')
        self._recordings: dict[str, Recording] = {}
        self._refused: set[str] = set()
        self._progress = self.create_publisher(Header, '/recorder/progress', 10)
        self._told_ns = -1
        self._next_discovery_ns = self._next_flush_ns = 0

    def run(self) -> None:
        """Record until asked to end, then drain what has arrived and close the bag."""
        self.tell_ready()
        try:
            while True:
                self.serve()
                now_ns = time.monotonic_ns()
                if now_ns >= self._next_discovery_ns:
                    self._next_discovery_ns = now_ns + DISCOVERY_NS
                    self._discover()
                if now_ns >= self._next_flush_ns:
                    self._next_flush_ns = now_ns + FLUSH_NS
                    self._bag.flush()
                    lost = sum(r.counter.lost for r in self._recordings.values())
                    self.statistics.details['lost'] = str(lost)
                self._drain()
                time.sleep(PAUSE_S)
        except StopRequestedError:
            self._drain()
            raise
        finally:
            self._bag.close()

    def _discover(self) -> None:
        """Subscribe to every topic that has appeared."""
        for topic, types in self.get_topic_names_and_types():
            if topic in self._recordings or topic in self._refused:
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if not offers or topic == '/recorder/progress':
                continue
            profile = _matching([offer.qos_profile for offer in offers])
            try:
                message_type = _message_type(types[0])
                topic_id = self._bag.add_topic(topic, types[0], _as_yaml(profile))
            except BagError as error:
                self._refused.add(topic)
                self.statistics.reject(str(error))
                continue
            reader = Reader(self, message_type, topic, profile)
            self._recordings[topic] = Recording(reader, topic_id, types[0])

    def _drain(self) -> None:
        """Write all that has arrived, and tell the simulator how far that is."""
        for recording in self._recordings.values():
            while (taken := recording.reader.take_with_times()) is not None:
                data, sent_ns, received_ns = taken
                self._bag.write(recording.topic_id, data, received_ns, sent_ns)
                recording.counter.receive(data)
                self.statistics.ticks += 1
        state = self._recordings.get(self.state_topic)
        stamp_ns = None if state is None else state.counter.last_ns
        if stamp_ns is not None and stamp_ns > self._told_ns:
            self._told_ns = stamp_ns
            self._progress.publish(header(stamp_ns))


def _message_type(name: str) -> type:
    """Return the class of `package/msg/Type`.

    Raises:
        BagError: If its package isn't installed.
    """
    package, _, kind = name.split('/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise BagError(f'{name} is not installed; its topic is not recorded') from None
    return found


def _matching(offered: list[QoSProfile]) -> QoSProfile:
    """Return a profile that gets everything from every publisher of a topic."""
    reliable = all(o.reliability == QoSReliabilityPolicy.RELIABLE for o in offered)
    latched = all(o.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for o in offered)
    return QoSProfile(
        depth=DEPTH,
        reliability=QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=(
            QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE
        ),
    )


def _as_yaml(profile: QoSProfile) -> str:
    reliable = profile.reliability == QoSReliabilityPolicy.RELIABLE
    latched = profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    return qos_yaml(
        'reliable' if reliable else 'best_effort', 'transient_local' if latched else 'volatile'
    )


def main() -> None:
    """Run the node."""
    run_node(RecorderNode)
