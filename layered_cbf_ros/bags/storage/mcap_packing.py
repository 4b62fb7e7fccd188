"""The records of an mcap file, packed into bytes as its specification lays them out."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence

from layered_cbf_ros.bags.storage.mcap_records import (
    CHANNEL,
    CHUNK,
    FOOTER,
    MAGIC,
    METADATA,
    RECORD_HEAD,
    SCHEMA,
)

HEADER, MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX = 0x01, 0x07, 0x08, 0x09, 0x0A
STATISTICS, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x0B, 0x0D, 0x0E, 0x0F
PRIVATE = 0x80
"""Records of an opcode from here on mean nothing to any reader; each steps over them."""


def packed_record(opcode: int, *parts: bytes) -> bytes:
    """Return a record of any kind."""
    return b''.join((RECORD_HEAD.pack(opcode, sum(map(len, parts))), *parts))


def packed_text(text: str) -> bytes:
    """Return a string behind its length."""
    data = text.encode()
    return struct.pack('<I', len(data)) + data


def packed_texts(entries: Mapping[str, str]) -> bytes:
    """Return a map of strings behind its length."""
    data = b''.join(packed_text(key) + packed_text(value) for key, value in entries.items())
    return struct.pack('<I', len(data)) + data


def packed_counts(entries: Mapping[int, int]) -> bytes:
    """Return a map from channels to counts, or to offsets, behind its length."""
    data = b''.join(struct.pack('<HQ', *entry) for entry in entries.items())
    return struct.pack('<I', len(data)) + data


def packed_beginning() -> bytes:
    """Return what every ROS 2 bag begins with."""
    return MAGIC + packed_record(HEADER, packed_text('ros2'), packed_text('layered_cbf_ros'))


def packed_schema(number: int, type_name: str, definition: str) -> bytes:
    """Return a message type's definition in the ros2msg form."""
    head = struct.pack('<H', number) + packed_text(type_name)
    return packed_record(SCHEMA, head, packed_text('ros2msg'), packed_text(definition))


def packed_channel(number: int, schema: int, topic: str, entries: Mapping[str, str]) -> bytes:
    """Return a topic, with what is told about it."""
    head = struct.pack('<HH', number, schema)
    return packed_record(
        CHANNEL, head, packed_text(topic), packed_text('cdr'), packed_texts(entries)
    )


def packed_note(name: str, entries: Mapping[str, str]) -> bytes:
    """Return a Metadata record: any texts, by name and key."""
    return packed_record(METADATA, packed_text(name), packed_texts(entries))


def packed_chunk(
    times: tuple[int, int], records: bytes, checksum: bool, compression: str, packed: bytes
) -> bytes:
    """Return a chunk.

    Args:
        times: First and last log time in it [ns].
        records: What it holds.
        checksum: Whether to store a checksum of that.
        compression: Its name, '' for none.
        packed: The records compressed.
    """
    check = zlib.crc32(records) if checksum else 0
    head = struct.pack('<QQQI', *times, len(records), check) + packed_text(compression)
    return packed_record(CHUNK, head, struct.pack('<Q', len(packed)), packed)


def packed_message_index(channel: int, entries: Sequence[int]) -> bytes:
    """Return where the messages of one channel stand in the chunk before.

    Args:
        channel: Its number.
        entries: Log time [ns] and offset of each message, in turn.
    """
    head = struct.pack('<HI', channel, 8 * len(entries))
    return packed_record(MESSAGE_INDEX, head, struct.pack(f'<{len(entries)}Q', *entries))


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
            offsets += packed_record(
                SUMMARY_OFFSET, struct.pack('<BQQ', opcode, start, len(records))
            )
            summary += records
    places = struct.pack('<QQ', summary_at, summary_at + len(summary))
    head = RECORD_HEAD.pack(FOOTER, len(places) + 4)
    checksum = zlib.crc32(summary + offsets + head + places)
    return summary + offsets + head + places + struct.pack('<I', checksum) + MAGIC
