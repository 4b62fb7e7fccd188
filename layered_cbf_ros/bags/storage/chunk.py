"""Messages gathered for one chunk of an mcap file."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection

import lz4.frame
import zstandard

from layered_cbf_ros.bags.storage.file_index import ChunkPlace
from layered_cbf_ros.bags.storage.mcap_packing import packed_chunk, packed_message_index
from layered_cbf_ros.bags.storage.mcap_records import MESSAGE
from layered_cbf_ros.bags.storage.presets import Preset

MESSAGE_RECORD = struct.Struct('<BQHIQQ')  # with the head that every record has
FIELDS_SIZE = MESSAGE_RECORD.size - 9


class Chunk:
    """Records gathered one by one, joined and compressed together.

    Attributes:
        size: Bytes gathered so far.
    """

    def __init__(self) -> None:
        self.size = 0
        self._parts: list[bytes] = []
        self._entries: dict[int, list[int]] = {}

    def add_record(self, record: bytes) -> None:
        """Add a schema or a channel."""
        self._parts.append(record)
        self.size += len(record)

    def add(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> int:
        """Add a message; return the size gathered so far. Runs for every message there is."""
        length = len(data)
        head = MESSAGE_RECORD.pack(
            MESSAGE, FIELDS_SIZE + length, channel, sequence, log_ns, publish_ns
        )
        entries = self._entries.get(channel)
        if entries is None:
            entries = self._entries[channel] = []
        entries += log_ns, self.size
        self._parts += head, data
        self.size += MESSAGE_RECORD.size + length
        return self.size

    @property
    def channels(self) -> Collection[int]:
        """Return which channels have messages in it."""
        return self._entries.keys()

    def spans(self) -> dict[int, tuple[int, int, int]]:
        """Return count, first and last log time [ns] of each channel."""
        return {
            channel: (len(entries) // 2, min(entries[::2]), max(entries[::2]))
            for channel, entries in self._entries.items()
        }

    def pack(
        self, offset: int, preset: Preset, compress: Callable[[bytes], bytes]
    ) -> tuple[bytes, ChunkPlace]:
        """Return the chunk's record with its message indexes, and its place.

        Args:
            offset: Where it will stand in the file.
            preset, compress: How to store it.
        """
        spans = self.spans().values()
        times = (
            min((first for _, first, _ in spans), default=0),
            max((last for _, _, last in spans), default=0),
        )
        records = b''.join(self._parts)
        packed = compress(records)
        chunk = packed_chunk(times, records, preset.checksum, preset.compression, packed)
        indexes, places = message_indexes(self._entries, offset + len(chunk))
        place = ChunkPlace(
            *times, offset, len(chunk), places, len(indexes), preset.compression,
            len(packed), len(records),
        )  # fmt: skip
        return chunk + indexes, place


def compressor(preset: Preset) -> Callable[[bytes], bytes]:
    """Return what compresses the records of a chunk."""
    if preset.compression == 'lz4':
        return lz4.frame.compress
    if preset.compression == 'zstd':
        return zstandard.ZstdCompressor(level=preset.level).compress
    return bytes


def message_indexes(entries: dict[int, list[int]], offset: int) -> tuple[bytes, dict[int, int]]:
    """Return the message indexes of a chunk, and the offset of each by channel.

    Args:
        entries: Log time [ns] and offset of each message in turn, by channel.
        offset: Where they will stand in the file.
    """
    records, places = b'', {}
    for channel, flat in entries.items():
        places[channel] = offset + len(records)
        records += packed_message_index(channel, flat)
    return records, places
