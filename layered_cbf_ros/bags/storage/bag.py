"""What every bag offers to who reads it, whoever recorded it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record, Topic


@dataclass
class Bag:
    """One bag, streamed as often as asked.

    Attributes:
        path: What was opened.
        files: The files that hold the messages, in order.
        truncated: After a pass: a file ends before its end, or is spoilt.
        counts: After a pass: messages by topic, also of topics that weren't asked for.
        log_span_ns: After a pass: first and last log time [ns]; zeros without a message.
        notes: After a pass: the recorder's own notes, texts by name and key.
    """

    path: Path
    files: tuple[Path, ...]
    truncated: bool = False
    counts: dict[str, int] = field(default_factory=dict)
    log_span_ns: tuple[int, int] = (0, 0)
    notes: dict[str, dict[str, str]] = field(default_factory=dict)

    @property
    def topics(self) -> dict[str, Topic]:
        """Return the topics by name; known before any pass.

        Raises:
            BagError: If the bag can't be read.
        """
        raise NotImplementedError

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return first and last log time [ns], zeros without a message; known before any pass.

        Raises:
            BagError: If the bag can't be read.
        """
        raise NotImplementedError

    @property
    def went_back_ns(self) -> dict[str, int]:
        """Return by how much the log time of a topic goes back in the order of the files [ns].

        Only of topics where it does, and of bags whose files tell; known before any pass.
        """
        return {}

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield messages in the order of the files: the fastest way through.

        Args:
            topics: Names of those wanted; None for all.

        Raises:
            BagError: If the bag can't be read.
        """
        raise NotImplementedError

    def in_time_order(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Yield messages in the order of their log times; equal ones in that of the files.

        Args:
            topics: Names of those wanted; None for all.
            start_ns: Leave out what was recorded before [ns].

        Raises:
            BagError: If the bag can't be read.
        """
        raise NotImplementedError

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[Record, Any]]:
        """Yield records together with the decoded message, as rosbags decodes it.

        Raises:
            BagError: If the bag can't be read or a message can't be decoded.
        """
        decoder = MessageDecoder()
        for record in self.records(topics):
            yield record, decoder.decode(record)

    def _begin_pass(self) -> None:
        """Forget what the last pass found."""
        self.truncated, self.counts, self.log_span_ns, self.notes = False, {}, (0, 0), {}

    def _count(self, topic: str, log_time_ns: int) -> None:
        """Take note of one message."""
        first, last = self.log_span_ns if self.counts else (log_time_ns, log_time_ns)
        self.log_span_ns = (min(first, log_time_ns), max(last, log_time_ns))
        self.counts[topic] = self.counts.get(topic, 0) + 1
