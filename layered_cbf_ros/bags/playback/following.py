"""Keeps a replay from running ahead of the node that it feeds."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from layered_cbf_ros.bags.playback.fed_node import FedNode
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import GraphError, MessageError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of

SPARE = 4  # ticks on the way to a node and back, beyond those of two answers
PATIENCE_NS = 10 * NS_PER_S


class Following:
    """Lets a leading message pass only if the node has answered all but the last few.

    A node that falls behind then delays its replay; it doesn't lose inputs.

    Attributes:
        answers: Messages that the node has sent on its answering topic.
        ahead: How many leading messages may be without an answer.
    """

    def __init__(self, node: FedNode, take: Callable[[], Iterable[bytes]]) -> None:
        """Choose whom to follow; take it for a node in lockstep.

        Args:
            node: The node.
            take: Returns its answers since the last call, serialised.
        """
        self.answers = 0
        self.ahead = 2 * node.ticks + SPARE
        self._node = node
        self._take = take
        self._unanswered: deque[int] = deque()
        self._newest_ns = -1
        self._waiting_since_ns: int | None = None

    def expect_real_time(self) -> None:
        """Let the node have no newer state while it works: it would skip the older ones."""
        self.ahead = self._node.ticks_in_real_time

    def may_send(self, record: Record, now_ns: int) -> bool:
        """Tell whether a message may be sent yet; it is taken as sent if so.

        Args:
            record: The message.
            now_ns: Monotonic clock [ns].

        Raises:
            GraphError: If the node has kept the replay waiting for too long.
        """
        if record.topic.name != self._node.leader:
            return True
        self.listen()
        if len(self._unanswered) >= self.ahead:
            self._wait(now_ns)
            return False
        self._waiting_since_ns = None
        stamp_ns = _stamp(record.data)
        if stamp_ns is not None and stamp_ns > self._newest_ns:
            self._newest_ns = stamp_ns
            self._unanswered.append(stamp_ns)
        return True

    def listen(self) -> None:
        """Take note of what the node has answered."""
        for data in self._take():
            self.answers += 1
            stamp_ns = _stamp(data)
            while stamp_ns is not None and self._unanswered and self._unanswered[0] <= stamp_ns:
                self._unanswered.popleft()

    def _wait(self, now_ns: int) -> None:
        if self._waiting_since_ns is None:
            self._waiting_since_ns = now_ns
        if now_ns - self._waiting_since_ns > PATIENCE_NS:
            first = self._unanswered[0] / NS_PER_S
            raise GraphError(
                f'{self._node.name} has not answered {self._node.leader} of {first:.3f} s, and '
                f'{self.ahead - 1} more, for {PATIENCE_NS // NS_PER_S} s; look at /diagnostics. In '
                'lockstep it must be new and be fed from stamp 0; else start it with '
                '-p time:=real_time'
            )


def _stamp(data: bytes) -> int | None:
    """Return the stamp of a message [ns], None if it has none."""
    try:
        return stamp_of(data)
    except MessageError:
        return None
