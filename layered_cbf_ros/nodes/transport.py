"""How bytes travel: raw messages taken by hand, one wait on the one that is needed.

An executor wakes a node for every message and deserialises it. Here a node waits
for exactly the message that its next tick needs; all others rest in their queues.
Only this module knows, and uses, the calls of rclpy that are not public.
"""

from __future__ import annotations

import os
import time
from collections import deque
from typing import Any, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.resources import find_folder

M = TypeVar('M')
RELIABLE_DEPTH = 32
KEPT_FOR_READERS = 128  # further than the simulator runs ahead of the recorder, in ticks
TRACK_DEPTH = 256  # several stamps of many tracks, each a message of its own
RESEND_DEPTH = 8  # beyond the largest latency of any input, counted in its messages
RESEND_PAUSE_NS = 20_000_000
DELIVERY = Duration(seconds=0.1)
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def find_each_other_fast() -> None:
    """Announce this process often at its start; to be called before ROS is initialised.

    Whoever has set a profile of his own keeps it.
    """
    os.environ.setdefault(PROFILES, str(find_folder('params') / 'fast_dds.xml'))


def reliable(depth: int = RELIABLE_DEPTH) -> QoSProfile:
    """Return the quality of service of the control path."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.RELIABLE)


def latched(depth: int = 1) -> QoSProfile:
    """Return the quality of service of values that late joiners get too.

    Args:
        depth: From how many publishers the last word is kept.
    """
    return QoSProfile(
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
    )


def decoded(data: bytes, message_type: type[M]) -> M:
    """Return a message as an object.

    Raises:
        MessageError: If the bytes are not such a message.
    """
    try:
        message: M = deserialize_message(data, message_type)
    except RuntimeError:  # what the middleware raises, whatever is wrong
        name = message_type.__name__
        raise MessageError(f'message of {len(data)} bytes is no {name}') from None
    return message


class TakenByHand(CallbackGroup):
    """A callback group that no executor serves."""

    def can_execute(self, entity: Any) -> bool:
        """Refuse, always."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse, always."""
        return False


class Reader:
    """One subscription whose messages are taken, as bytes, when they are wanted."""

    def __init__(
        self, node: Node, message_type: type, topic: str, qos: QoSProfile | None = None
    ) -> None:
        subscription = node.create_subscription(
            message_type,
            topic,
            lambda _: None,
            qos or reliable(),
            callback_group=TakenByHand(),
            raw=True,
        )
        self._subscription = subscription
        self._handle = subscription.handle
        self._type = message_type
        self._wait_set = _rclpy.WaitSet(1, 0, 0, 0, 0, 0, node.context.handle)
        self.topic = subscription.topic_name

    def take(self) -> bytes | None:
        """Return the oldest message that waits, None if there is none."""
        taken = self._handle.take_message(self._type, True)
        return None if taken is None else taken[0]

    def take_with_origin(self) -> tuple[bytes, int, int, int] | None:
        """Return a message, the wall times it was sent and received at [ns], and its number.

        Each publisher numbers its messages 1, 2, 3, ...
        """
        taken = self._handle.take_message(self._type, True)
        if taken is None:
            return None
        data, info = taken
        return (
            data,
            info['source_timestamp'],
            info['received_timestamp'],
            info['publication_sequence_number'],
        )

    def wait(self, timeout: float) -> None:
        """Block until a message is there, or for timeout [s] of wall time."""
        self._wait_set.clear_entities()
        self._wait_set.add_subscription(self._handle)
        self._wait_set.wait(int(timeout * 1e9))

    def poll(self, duration_ns: int) -> bytes | None:
        """Take, yielding the processor in between, for a short time [ns]."""
        end_ns = time.monotonic_ns() + duration_ns
        while (data := self.take()) is None and time.monotonic_ns() < end_ns:
            os.sched_yield()
        return data

    @property
    def publishers(self) -> int:
        """Return how many publishers are matched."""
        return int(self._handle.get_publisher_count())

    def end(self, node: Node) -> None:
        """Unsubscribe; what was not taken is gone."""
        node.destroy_subscription(self._subscription)


class Writer:
    """One publisher of bytes that can send its last messages again."""

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        expected_readers: int = 1,
        kept: int = RESEND_DEPTH,
    ) -> None:
        depth = max(KEPT_FOR_READERS, kept)
        self._publisher = node.create_publisher(message_type, topic, reliable(depth))
        self._ring: deque[bytes] = deque(maxlen=kept)
        self._resent_ns = 0
        self.expected_readers = expected_readers
        self.topic = self._publisher.topic_name

    def publish(self, data: bytes) -> None:
        """Send a message."""
        self._publisher.publish(data)
        self._ring.append(data)

    def resend(self, now_ns: int) -> None:
        """Send the last messages again, at most once in RESEND_PAUSE_NS."""
        if now_ns - self._resent_ns < RESEND_PAUSE_NS:
            return
        self._resent_ns = now_ns
        for data in self._ring:
            self._publisher.publish(data)

    def see_delivered(self) -> None:
        """Wait a moment until all readers have the last messages."""
        self._publisher.wait_for_all_acked(DELIVERY)

    @property
    def readers(self) -> int:
        """Return how many subscriptions are matched."""
        return int(self._publisher.get_subscription_count())
