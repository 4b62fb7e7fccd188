"""What one pass through a bag finds out about a topic."""

from __future__ import annotations

import struct

from rosbags.typesys.store import Typestore

from layered_cbf_ros.bags.inspection.layout import Layout, begins_with_stamp, lay_out
from layered_cbf_ros.bags.inspection.stamps import StampTrack
from layered_cbf_ros.bags.recording.topic_counter import STAMPED
from layered_cbf_ros.bags.storage.decoding import typestore_of
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import STAMP_OFFSET

CLOCK = 'rosgraph_msgs/msg/Clock'
TOLERANCE_NS = 100_000_000
"""Age of a stamp at which topics of one sender at a steady rate have fallen back [ns]."""

LOOSE_TOLERANCE_NS = NS_PER_S
"""The same of topics that many may send on [ns]."""

LOG_TOLERANCE_NS = 100_000_000
"""A topic's messages may be logged out of order by this [ns]."""

KEPT_LAYOUTS = 256
STAMPS = {
    order: struct.Struct(f'{order}{STAMP_OFFSET}xiI').unpack_from for order in ('<', '>')
}  # fmt: skip


class TopicStatistics:
    """Takes every message of one topic.

    Attributes:
        topic: The topic.
        count: Messages.
        log_first_ns, log_last_ns: Earliest and latest log time [ns].
        log_jump_ns: The largest step back of the log time [ns].
        log_jump_from_ns: The log time before it [ns].
        bad_type: Why no message can be checked, '' if they can.
        misfits: Messages that aren't what their type says.
        first_misfit: What is wrong with the first, and its log time [ns].
        stamps: The course of the stamps, None if the type has none.
    """

    def __init__(self, topic: Topic) -> None:
        self.topic = topic
        self.count = 0
        self.log_first_ns = self.log_last_ns = 0
        self.log_jump_ns = self.log_jump_from_ns = 0
        self.bad_type = ''
        self.misfits = 0
        self.first_misfit = ('', 0)
        self.stamps: StampTrack | None = None
        self._log_ns = 0
        self._layouts: dict[int, Layout] = {}
        self._store: Typestore | None = None
        try:
            self._store = typestore_of(topic)
        except BagError as error:
            self.bad_type = str(error)
        else:
            if begins_with_stamp(self._store, topic.type_name):
                self.stamps = StampTrack(_tolerance_of(topic.type_name))

    def take(self, record: Record) -> bool:
        """Take the next message; tell whether it is what its type says."""
        log_ns = record.log_time_ns
        if not self.count:
            self.log_first_ns = self.log_last_ns = log_ns
        elif log_ns > self.log_last_ns:
            self.log_last_ns = log_ns
        elif log_ns < self._log_ns:
            self.log_first_ns = min(self.log_first_ns, log_ns)
            if self._log_ns - log_ns > self.log_jump_ns:
                self.log_jump_ns, self.log_jump_from_ns = self._log_ns - log_ns, self._log_ns
        self.count += 1
        self._log_ns = log_ns
        if self._store is None:
            return False
        data = record.data
        layout = self._layouts.get(len(data))
        if layout is None or not layout.fits(data):
            layout = self._learn(self._store, record)
            if layout is None:
                return False
        if self.stamps is not None:
            seconds, nanoseconds = STAMPS[layout.order](data)
            self.stamps.take(seconds * NS_PER_S + nanoseconds, log_ns)
        return True

    @property
    def log_rate(self) -> float | None:
        """Messages per second of log time [Hz]; None if that has no meaning."""
        span_ns = self.log_last_ns - self.log_first_ns
        return 1e9 * (self.count - 1) / span_ns if span_ns > 0 else None

    @property
    def log_jumps(self) -> bool:
        """Whether the log time fell back."""
        return self.log_jump_ns > LOG_TOLERANCE_NS

    def _learn(self, store: Typestore, record: Record) -> Layout | None:
        """Lay out a message; None, and it counts as a misfit, if that can't be done."""
        try:
            layout = lay_out(store, self.topic.type_name, record.data)
        except BagError as error:
            if not self.misfits:
                self.first_misfit = str(error), record.log_time_ns
            self.misfits += 1
            return None
        if len(self._layouts) >= KEPT_LAYOUTS:
            self._layouts.clear()
        self._layouts[len(record.data)] = layout
        return layout


def _tolerance_of(type_name: str) -> int:
    """Return by how much stamps may fall back without a jump [ns]."""
    if type_name == CLOCK:
        return 0
    return TOLERANCE_NS if type_name in STAMPED else LOOSE_TOLERANCE_NS
