"""The index at the end of an mcap file, gathered while the file is written or looked through."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from layered_cbf_ros.bags.storage.mcap_packing import (
    ATTACHMENT_INDEX,
    CHUNK_INDEX,
    DATA_END,
    METADATA_INDEX,
    STATISTICS,
    packed_counts,
    packed_end,
    packed_record,
    packed_text,
)
from layered_cbf_ros.bags.storage.mcap_records import CHANNEL, SCHEMA, text_at


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """Where a chunk stands, and what is in it.

    Attributes:
        first_ns, last_ns: Log times [ns].
        offset, length: Of its record in the file.
        indexes: Offsets of the message indexes behind it, by channel.
        indexes_length: Length of these together.
        compression: Its name, '' for none.
        packed_size, size: Length of its records, compressed and not.
    """

    first_ns: int
    last_ns: int
    offset: int
    length: int
    indexes: Mapping[int, int]
    indexes_length: int
    compression: str
    packed_size: int
    size: int


@dataclass
class FileIndex:
    """What the end of a file tells of all before.

    Attributes:
        schemas, channels: Their whole records, by number.
        counts: Messages by channel.
        first_ns, last_ns: Log times [ns], both 0 while there is no message.
    """

    schemas: dict[int, bytes] = field(default_factory=dict)
    channels: dict[int, bytes] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    first_ns: int = 0
    last_ns: int = 0
    _chunks: list[bytes] = field(default_factory=list)
    _notes: list[bytes] = field(default_factory=list)
    _attachments: list[bytes] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Return how many messages there are."""
        return sum(self.counts.values())

    def add_messages(self, channel: int, count: int, first_ns: int, last_ns: int) -> None:
        """Count messages of a channel, logged in a span of time [ns]."""
        empty = not self.counts
        self.first_ns = first_ns if empty else min(self.first_ns, first_ns)
        self.last_ns = max(self.last_ns, last_ns)
        self.counts[channel] += count

    def learn(self, opcode: int, body: bytes | memoryview) -> None:
        """Take a schema or a channel in; whatever else it is, do nothing."""
        known = {SCHEMA: self.schemas, CHANNEL: self.channels}.get(opcode)
        if known is not None:
            known[int.from_bytes(body[:2], 'little')] = packed_record(opcode, bytes(body))

    def add_chunk(self, place: ChunkPlace) -> None:
        """Take a chunk in."""
        self._chunks.append(packed_record(
            CHUNK_INDEX,
            struct.pack('<QQQQ', place.first_ns, place.last_ns, place.offset, place.length),
            packed_counts(place.indexes),
            struct.pack('<Q', place.indexes_length),
            packed_text(place.compression),
            struct.pack('<QQ', place.packed_size, place.size),
        ))  # fmt: skip

    def add_note(self, offset: int, length: int, name: str) -> None:
        """Take a Metadata record in."""
        place = struct.pack('<QQ', offset, length)
        self._notes.append(packed_record(METADATA_INDEX, place, packed_text(name)))

    def add_attachment(self, offset: int, length: int, body: memoryview) -> None:
        """Take an attachment in."""
        name, at = text_at(body, 16)
        kind, at = text_at(body, at)
        size, times = bytes(body[at : at + 8]), bytes(body[:16])
        self._attachments.append(packed_record(
            ATTACHMENT_INDEX,
            struct.pack('<QQ', offset, length) + times + size,
            packed_text(name),
            packed_text(kind),
        ))  # fmt: skip

    def ending(self, offset: int, chunked: bool = True) -> bytes:
        """Return all that stands behind the data.

        Args:
            offset: Where it will stand in the file.
            chunked: Whether all messages are in chunks; if not, readers must not go by
                the chunks alone, and get none to go by.
        """
        end = packed_record(DATA_END, bytes(4))
        chunks = self._chunks if chunked else []
        groups = [
            (SCHEMA, b''.join(self.schemas.values())),
            (CHANNEL, b''.join(self.channels.values())),
            (STATISTICS, self._statistics(len(self._chunks))),
            (CHUNK_INDEX, b''.join(chunks)),
            (ATTACHMENT_INDEX, b''.join(self._attachments)),
            (METADATA_INDEX, b''.join(self._notes)),
        ]
        return end + packed_end(offset + len(end), groups)

    def _statistics(self, chunks: int) -> bytes:
        numbers = (self.count, len(self.schemas), len(self.channels))
        parts = (len(self._attachments), len(self._notes), chunks)
        times = (self.first_ns, self.last_ns)
        head = struct.pack('<QHIIIIQQ', *numbers, *parts, *times)
        return packed_record(STATISTICS, head, packed_counts(self.counts))
