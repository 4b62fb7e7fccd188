"""Records of an mcap file as bytes, packed by the mcap library.

Its own writer can only begin a file; here files are also finished that somebody else began,
and a chunk that doesn't fit on the disk is taken back whole.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    Metadata,
    Schema,
    SummaryOffset,
)

from layered_cbf_ros.bags.storage.mcap_records import MAGIC, RECORD_HEAD

PRIVATE = 0x80
"""Records of an opcode from here on mean nothing to any reader; each steps over them."""

CHECKSUM = struct.Struct('<I')


def packed(*records: McapRecord) -> bytes:
    """Return records one behind the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def packed_record(opcode: int, *parts: bytes) -> bytes:
    """Return a record of any kind whose body is packed already."""
    return b''.join((RECORD_HEAD.pack(opcode, sum(map(len, parts))), *parts))


def packed_beginning() -> bytes:
    """Return what every ROS 2 bag begins with."""
    return MAGIC + packed(Header('ros2', 'layered_cbf_ros'))


def packed_schema(number: int, type_name: str, definition: str) -> bytes:
    """Return a message type's definition in the ros2msg form."""
    return packed(Schema(number, definition.encode(), 'ros2msg', type_name))


def packed_channel(number: int, schema: int, topic: str, entries: Mapping[str, str]) -> bytes:
    """Return a topic, with what is told about it."""
    return packed(Channel(number, topic, 'cdr', dict(entries), schema))


def packed_note(name: str, entries: Mapping[str, str]) -> bytes:
    """Return a Metadata record: any texts, by name and key."""
    return packed(Metadata(name, dict(entries)))


def packed_chunk(
    times: tuple[int, int], records: bytes, checksum: bool, compression: str, compressed: bytes
) -> bytes:
    """Return a chunk.

    Args:
        times: First and last log time in it [ns].
        records: What it holds.
        checksum: Whether to store a checksum of that.
        compression: Its name, '' for none.
        compressed: The records compressed.
    """
    check = zlib.crc32(records) if checksum else 0
    first_ns, last_ns = times
    return packed(Chunk(compression, compressed, last_ns, first_ns, check, len(records)))


def packed_message_index(channel: int, entries: Sequence[int]) -> bytes:
    """Return where the messages of one channel stand in the chunk before.

    In one go: the library packs entry by entry, which the recorder would feel.

    Args:
        channel: Its number.
        entries: Log time [ns] and offset of each message, in turn.
    """
    head = struct.pack('<HI', channel, 8 * len(entries))
    return packed_record(Opcode.MESSAGE_INDEX, head, struct.pack(f'<{len(entries)}Q', *entries))


def packed_end(summary_at: int, groups: Sequence[tuple[int, bytes]]) -> bytes:
    """Return the summary, the footer, and what stands behind it.

    Args:
        summary_at: Offset of the summary in the file.
        groups: Its records, those of one opcode together.
    """
    summary, offsets = b'', b''
    for opcode, records in groups:
        if records:
            start = summary_at + len(summary)
            offsets += packed(SummaryOffset(opcode, start, len(records)))
            summary += records
    footer = packed(Footer(summary_at, summary_at + len(summary), 0))[: -CHECKSUM.size]
    checksum = zlib.crc32(summary + offsets + footer)
    return summary + offsets + footer + CHECKSUM.pack(checksum) + MAGIC
