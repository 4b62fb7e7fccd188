"""What a bag holds, in figures."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from layered_cbf_ros.bags.inspection.topic_statistics import TopicStatistics
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.interfaces import NS_PER_S

BEST_EFFORT = ('best_effort', 2)
LATCHED = ('transient_local', 1)
"""Older bags tell a number instead of a word."""


@dataclass(frozen=True, slots=True)
class FileInfo:
    """A file of a bag.

    Attributes:
        name: Its name.
        size: [byte].
    """

    name: str
    size: int


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag; None is what has no meaning for it.

    Attributes:
        name: Full name.
        type_name: `package/msg/Type`.
        count: Messages.
        log_rate_hz: Messages per second of log time.
        stamp_rate_hz: Messages per second of their stamps.
        longest_gap_s: Longest time between a stamp and the next newer one.
        longest_gap_from_s: The stamp before it.
        offered: Offered QoS in short.
        misfits: Messages that aren't what their type says.
    """

    name: str
    type_name: str
    count: int
    log_rate_hz: float | None
    stamp_rate_hz: float | None
    longest_gap_s: float | None
    longest_gap_from_s: float | None
    offered: str
    misfits: int


@dataclass(frozen=True, slots=True)
class BagInfo:
    """A bag.

    Attributes:
        path: What was opened.
        storage: 'mcap' or 'sqlite3'.
        files: Its files, in order.
        start_ns, end_ns: First and last log time [ns]; zeros without a message.
        messages: How many.
        truncated: Whether it ends before its end.
        topics: Its topics, by name.
        notes: What the recorder tells of itself.
    """

    path: str
    storage: str
    files: tuple[FileInfo, ...]
    start_ns: int
    end_ns: int
    messages: int
    truncated: bool
    topics: tuple[TopicInfo, ...]
    notes: Mapping[str, Mapping[str, str]]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last message, by log time [s]."""
        return (self.end_ns - self.start_ns) / NS_PER_S

    @property
    def size(self) -> int:
        """Size of all files [byte]."""
        return sum(file.size for file in self.files)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return dataclasses.asdict(self) | {'duration_s': self.duration_s, 'size': self.size}


def info_of(bag: Bag, statistics: Mapping[str, TopicStatistics]) -> BagInfo:
    """Return what a pass through a bag found.

    Args:
        bag: The bag, after the pass.
        statistics: Of each topic that has messages.
    """
    topics = [
        _topic_info(statistics.get(name) or TopicStatistics(topic))
        for name, topic in sorted(bag.topics.items())
    ]
    start_ns, end_ns = bag.log_span_ns
    return BagInfo(
        path=str(bag.path),
        storage='mcap' if '.mcap' in bag.files[0].suffixes else 'sqlite3',
        files=tuple(FileInfo(file.name, file.stat().st_size) for file in bag.files),
        start_ns=start_ns,
        end_ns=end_ns,
        messages=sum(bag.counts.values()),
        truncated=bag.truncated,
        topics=tuple(topics),
        notes=bag.notes,
    )


def _topic_info(statistics: TopicStatistics) -> TopicInfo:
    stamps, topic = statistics.stamps, statistics.topic
    gap = None if stamps is None or not stamps.longest_gap_ns else stamps
    return TopicInfo(
        name=topic.name,
        type_name=topic.type_name,
        count=statistics.count,
        log_rate_hz=statistics.log_rate,
        stamp_rate_hz=None if stamps is None else stamps.rate,
        longest_gap_s=None if gap is None else gap.longest_gap_ns / NS_PER_S,
        longest_gap_from_s=None if gap is None else gap.gap_from_ns / NS_PER_S,
        offered=offered_qos(topic.qos),
        misfits=statistics.misfits,
    )


def offered_qos(text: str) -> str:
    """Return offered QoS profiles in short: 'reliable' or 'best effort', and 'latched'.

    Args:
        text: The profiles as rosbag2 stores them; what can't be read is ''.
    """
    try:
        profiles = yaml.safe_load(text) or []
        shorts = [
            ('best effort' if profile['reliability'] in BEST_EFFORT else 'reliable')
            + (', latched' if profile['durability'] in LATCHED else '')
            for profile in profiles
        ]
    except (yaml.YAMLError, TypeError, KeyError):
        return ''
    return ' / '.join(dict.fromkeys(shorts))
