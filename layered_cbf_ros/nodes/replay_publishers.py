"""The publishers of a replay: each topic's own type, name and quality of service."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from rclpy.duration import Duration, Infinite
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    QoSCompatibility,
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSLivelinessPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
    qos_check_compatible,
)

from layered_cbf_ros.bags.playback.offered_qos import OfferedQos, qos_to_offer
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.nodes.message_types import message_class

RESEND_DEPTH = 1000  # what a reader asks for again must still be there at full rate
OF_EVERY_NODE = ('/parameter_events', '/rosout')
UNTOLD_HASH = 'INVALID'
ACKNOWLEDGED_SLICE_S = 0.1


class ReplayPublishers:
    """Sends records to the topics that they come from, or to their new names.

    Attributes:
        left_out: Why topics can't be played, by their names in the bag.
    """

    def __init__(self, node: Node, topics: Mapping[str, Topic], names: Mapping[str, str]) -> None:
        """Make the publishers.

        Args:
            node: Whose they are.
            topics: Of the bag.
            names: Names to send under, by the topics to play.

        Raises:
            BagError: If no topic can be played, or a topic's profiles can't be read.
        """
        self._node = node
        self._offered: dict[str, OfferedQos] = {}
        self._publishers: dict[str, Publisher] = {}
        self.left_out: dict[str, str] = {}
        for name, sent_as in names.items():
            offered = qos_to_offer(topics[name])
            try:
                kind = message_class(topics[name].type_name)
            except BagError as error:
                self.left_out[name] = str(error)
                continue
            self._offered[name] = offered
            self._publishers[name] = node.create_publisher(
                kind,
                sent_as,
                profile_of(offered),
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
            self._check_hash(topics[name])
        if not self._publishers:
            raise BagError(f'nothing can be played: {next(iter(self.left_out.values()))}')

    @property
    def topics(self) -> set[str]:
        """Return the topics that are played, by their names in the bag."""
        return set(self._publishers)

    @property
    def latched(self) -> dict[str, int]:
        """Return how many messages each latched topic keeps, 0 for all."""
        return {
            name: offered.depth
            for name, offered in self._offered.items()
            if offered.durability == 'transient_local'
        }

    @property
    def matched(self) -> int:
        """Return how many readers there are in all."""
        return sum(p.get_subscription_count() for p in self._publishers.values())

    def publish(self, record: Record) -> None:
        """Send one message."""
        self._publishers[record.topic.name].publish(record.data)

    def is_heard(self, topic: str) -> bool:
        """Tell whether a topic of the bag has a reader."""
        return bool(self._publishers[topic].get_subscription_count())

    def sent_as(self, topic: str) -> str:
        """Return the name that a topic of the bag is sent under."""
        return str(self._publishers[topic].topic_name)

    def check_types(self, topics: Mapping[str, Topic]) -> None:
        """Make sure that live topics of these names have these types.

        Raises:
            BagError: Naming the first topic that hasn't.
        """
        live = dict(self._node.get_topic_names_and_types())
        for name in self._publishers:
            sent_as, kind = self.sent_as(name), topics[name].type_name
            others = [other for other in live.get(sent_as, []) if other != kind]
            if others and sent_as not in OF_EVERY_NODE:
                raise BagError(
                    f'{sent_as} is {kind} in the bag but {others[0]} in the running system; '
                    f'rename it with --remap {name}:=/NAME or leave it out'
                )

    def warnings(self) -> list[str]:
        """Return what a person should know of who else is on these topics, a line each."""
        found = []
        for name, publisher in self._publishers.items():
            sent_as = self.sent_as(name)
            others = {
                _full_name(info.node_namespace, info.node_name)
                for info in self._node.get_publishers_info_by_topic(sent_as)
            } - {self._node.get_fully_qualified_name()}
            if others and sent_as not in OF_EVERY_NODE:
                found.append(f'{sent_as} is also sent by {", ".join(sorted(others))}')
            for info in self._node.get_subscriptions_info_by_topic(sent_as):
                fit, reason = qos_check_compatible(publisher.qos_profile, info.qos_profile)
                if fit == QoSCompatibility.ERROR:
                    listener = _full_name(info.node_namespace, info.node_name)
                    found.append(f'{listener} gets nothing of {sent_as}: {reason.strip()}')
        return found

    def not_acknowledged(self, limit_s: float, stopped: Callable[[], bool]) -> list[str]:
        """Wait until all readers have everything; return the topics of those that have not.

        Args:
            limit_s: How long to wait in all [s].
            stopped: Tells that it is enough.
        """
        end = time.monotonic() + limit_s
        waiting = [p for p in self._publishers.values() if p.get_subscription_count()]
        while waiting and not stopped():
            left = min(ACKNOWLEDGED_SLICE_S, max(0.0, end - time.monotonic()))
            if waiting[-1].wait_for_all_acked(Duration(seconds=left)):
                waiting.pop()
            elif left <= 0.0:
                break
        return [publisher.topic_name for publisher in waiting]

    def _check_hash(self, topic: Topic) -> None:
        """Leave a topic out whose type is another version than the installed one."""
        publisher = self._publishers[topic.name]
        own = self._node.get_fully_qualified_name()
        for info in self._node.get_publishers_info_by_topic(publisher.topic_name):
            installed = str(info.topic_type_hash)
            if (
                _full_name(info.node_namespace, info.node_name) == own
                and info.topic_type == topic.type_name
                and topic.type_hash
                and installed not in (topic.type_hash, UNTOLD_HASH)
            ):
                self._node.destroy_publisher(publisher)
                del self._publishers[topic.name], self._offered[topic.name]
                self.left_out[topic.name] = (
                    f"type '{topic.type_name}' is installed in another version than recorded "
                    f'({installed}, not {topic.type_hash})'
                )
                return


def profile_of(offered: OfferedQos) -> QoSProfile:
    """Return a profile as rclpy has it.

    What is kept of a topic that isn't latched is this side's affair: so much that a
    reader can ask again for what it missed.
    """
    latched = offered.durability == 'transient_local'
    depth = offered.depth if latched else max(offered.depth, RESEND_DEPTH)
    history = QoSHistoryPolicy.KEEP_LAST if offered.depth else QoSHistoryPolicy.KEEP_ALL
    return QoSProfile(
        history=history,
        depth=depth if offered.depth else 0,
        reliability=(
            QoSReliabilityPolicy.RELIABLE
            if offered.reliability == 'reliable'
            else QoSReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE
        ),
        deadline=_duration(offered.deadline_ns),
        lifespan=_duration(offered.lifespan_ns),
        liveliness=(
            QoSLivelinessPolicy.MANUAL_BY_TOPIC
            if offered.liveliness == 'manual_by_topic'
            else QoSLivelinessPolicy.AUTOMATIC
        ),
        liveliness_lease_duration=_duration(offered.lease_ns),
    )


def _duration(length_ns: int) -> Duration:
    return Duration(nanoseconds=length_ns) if length_ns else Infinite


def _full_name(namespace: str, name: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'
