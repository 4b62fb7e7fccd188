"""The index at the end of an mcap file, gathered while the file is written or looked through."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    ChunkIndex,
    DataEnd,
    MetadataIndex,
    Statistics,
)

from layered_cbf_ros.bags.storage.mcap_packing import packed, packed_end, packed_record
from layered_cbf_ros.bags.storage.mcap_records import CHANNEL, SCHEMA


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
        index = ChunkIndex(
            chunk_length=place.length,
            chunk_start_offset=place.offset,
            compression=place.compression,
            compressed_size=place.packed_size,
            message_end_time=place.last_ns,
            message_index_length=place.indexes_length,
            message_index_offsets=dict(place.indexes),
            message_start_time=place.first_ns,
            uncompressed_size=place.size,
        )
        self._chunks.append(packed(index))

    def add_note(self, offset: int, length: int, name: str) -> None:
        """Take a Metadata record in."""
        self._notes.append(packed(MetadataIndex(offset, length, name)))

    def add_attachment(self, offset: int, length: int, body: memoryview) -> None:
        """Take an attachment in."""
        found = Attachment.read(ReadDataStream(BytesIO(body)))
        index = AttachmentIndex(
            offset,
            length,
            found.log_time,
            found.create_time,
            len(found.data),
            found.name,
            found.media_type,
        )
        self._attachments.append(packed(index))

    def ending(self, offset: int, chunked: bool = True) -> bytes:
        """Return all that stands behind the data.

        Args:
            offset: Where it will stand in the file.
            chunked: Whether all messages are in chunks; if not, readers must not go by
                the chunks alone, and get none to go by.
        """
        end = packed(DataEnd(0))
        chunks = self._chunks if chunked else []
        groups = [
            (SCHEMA, b''.join(self.schemas.values())),
            (CHANNEL, b''.join(self.channels.values())),
            (Opcode.STATISTICS, self._statistics(len(self._chunks))),
            (Opcode.CHUNK_INDEX, b''.join(chunks)),
            (Opcode.ATTACHMENT_INDEX, b''.join(self._attachments)),
            (Opcode.METADATA_INDEX, b''.join(self._notes)),
        ]
        return end + packed_end(offset + len(end), groups)

    def _statistics(self, chunks: int) -> bytes:
        return packed(
            Statistics(
                attachment_count=len(self._attachments),
                channel_count=len(self.channels),
                channel_message_counts=dict(self.counts),
                chunk_count=chunks,
                message_count=self.count,
                message_end_time=self.last_ns,
                message_start_time=self.first_ns,
                metadata_count=len(self._notes),
                schema_count=len(self.schemas),
            )
        )
