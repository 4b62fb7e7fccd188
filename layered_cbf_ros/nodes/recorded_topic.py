"""One topic that the recorder records: subscribed as its publishers offer it, and counted."""

from __future__ import annotations

import time

from rclpy.node import Node
from rclpy.qos import QoSProfile

from layered_cbf_ros.bags.recording.losses import TopicLosses
from layered_cbf_ros.bags.recording.progress import TopicProgress
from layered_cbf_ros.bags.recording.sequence_counter import SequenceCounter
from layered_cbf_ros.bags.recording.topic_counter import counter_for
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.nodes.message_types import message_class
from layered_cbf_ros.nodes.offered_qos import as_yaml, in_words, matching
from layered_cbf_ros.nodes.transport import Reader

DEPTH = 2000  # beyond the window in which the simulator waits for the recorder
HANDOVER_S = 2.0  # longest time in which a new subscription finds all publishers [s]
AT_ONCE = 1000  # messages taken of one topic before the others have their turn


class RecordedTopic:
    """Takes every message of one topic into the bag.

    Attributes:
        name, type_name: The topic.
        stamps: Counts by stamps.
        progress: How far it is recorded, by these.
        sequences: Counts by the numbers of the publishers.
    """

    def __init__(self, node: Node, name: str, type_name: str, bag: BagWriter) -> None:
        """Subscribe.

        Raises:
            BagError: If the type isn't installed.
        """
        self.name, self.type_name = name, type_name
        self._node, self._bag = node, bag
        self._type = message_class(type_name)
        offered = self._offered()
        self.topic_id = bag.add_topic(name, type_name, as_yaml(offered))
        self._profile = matching(offered, DEPTH)
        self._reader = Reader(node, self._type, name, self._profile)
        self._former: Reader | None = None
        self._heard_once: set[tuple[int, int]] = set()
        self._handover_ends = 0.0
        self.stamps = counter_for(type_name)
        self.progress = TopicProgress(self.stamps)
        self.sequences = SequenceCounter(lambda: self._reader.publishers)

    @property
    def losses(self) -> TopicLosses:
        """Return what was counted so far."""
        stamps, sequences = self.stamps, self.sequences
        return TopicLosses(
            stamps.received, sequences.lost, sequences.missed_before, stamps.repeated, stamps.lost
        )

    def described(self) -> str:
        """Return what is recorded, for a person."""
        return f'{self.name} [{self.type_name}], {in_words(self._profile)}'

    def drain(self) -> int:
        """Write what has arrived into the bag; return how many messages that was.

        Raises:
            BagError: If the bag can't be written.
        """
        if self._handover_ends:
            return self._hand_over()
        take, write, topic_id = self._reader.take_with_origin, self._bag.write, self.topic_id
        count_number, count_stamp = self.sequences.receive, self.stamps.receive
        for count in range(AT_ONCE):
            taken = take()
            if taken is None:
                return count
            data, sent_ns, received_ns, number = taken
            write(topic_id, data, received_ns, sent_ns, number)
            count_number(number)
            count_stamp(data)
        return AT_ONCE

    def follow(self) -> str:
        """Do as the publishers offer by now; return what changed, in words, '' if nothing.

        A publisher that came later and offers less would not be heard: so subscribe anew.
        """
        offered = self._offered()
        if not offered:
            return ''
        told = self._bag.set_qos(self.topic_id, as_yaml(offered))
        profile = matching(offered, DEPTH)
        if self._handover_ends or not _asks_less(profile, self._profile):
            return ''
        self._former, self._profile = self._reader, profile
        self._reader = Reader(self._node, self._type, self.name, profile)
        self._handover_ends = time.monotonic() + HANDOVER_S
        late = '' if told else '; the bag tells what was offered before'
        return f'{self.name}: a publisher offers less; subscribed anew, {in_words(profile)}{late}'

    def end(self) -> None:
        """Unsubscribe."""
        for reader in filter(None, (self._reader, self._former)):
            reader.end(self._node)

    def _hand_over(self) -> int:
        """Drain two subscriptions, each message once, until the former isn't needed."""
        is_over = time.monotonic() > self._handover_ends
        former, count = self._former, 0
        may_end = former is not None and (is_over or self._reader.publishers > former.publishers)
        for reader in filter(None, (former, self._reader)):
            while (taken := reader.take_with_origin()) is not None:
                data, sent_ns, received_ns, number = taken
                if (sent_ns, number) in self._heard_once:
                    self._heard_once.remove((sent_ns, number))
                    continue
                self._heard_once.add((sent_ns, number))
                self._bag.write(self.topic_id, data, received_ns, sent_ns, number)
                self.sequences.receive(number)
                self.stamps.receive(data)
                count += 1
        if may_end and former is not None:  # the rest of what it heard is still to come twice
            former.end(self._node)
            self._former, self._handover_ends = None, time.monotonic() + HANDOVER_S
        elif is_over:
            self._heard_once, self._handover_ends = set(), 0.0
        return count

    def _offered(self) -> list[QoSProfile]:
        infos = self._node.get_publishers_info_by_topic(self.name)
        return [info.qos_profile for info in infos]


def _asks_less(one: QoSProfile, other: QoSProfile) -> bool:
    """Tell whether a profile is content with a publisher that another refuses."""
    return one.reliability > other.reliability or one.durability > other.durability
