"""Looks through an mcap file that may be damaged, and gathers the index it should have."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode

from layered_cbf_ros.bags.storage.chunk import Chunk, message_indexes
from layered_cbf_ros.bags.storage.file_index import ChunkPlace, FileIndex
from layered_cbf_ros.bags.storage.mcap_packing import packed_channel, packed_record
from layered_cbf_ros.bags.storage.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    MESSAGE,
    MESSAGE_HEAD,
    METADATA,
    RECORD_HEAD,
    SCHEMA,
    UNPACKING_ERRORS,
    Channels,
    FileEnd,
    chunk_records,
    file_records,
    note_of,
    text_at,
)

Entries = dict[int, list[int]]
"""Log time [ns] and offset in the chunk of each message in turn, by channel."""


@dataclass
class FileScan:
    """What a file holds.

    Attributes:
        index: The index it should have.
        channels: Its topics, by channel.
        begins: Whether it has a header.
        ends: Whether it has its footer, and all before it is sound.
        data_end: Where its data ends [bytes]: behind the last whole record of it.
        missing: Message indexes that the last chunk lacks; they belong at `data_end`.
        spoilt: Offsets of chunks, and of other records, that can't be unpacked.
        rescued: What could be unpacked of them.
        torn: Whether what stands at `data_end` is data too, but not whole.
        chunked: Whether all messages are in chunks.
    """

    index: FileIndex = field(default_factory=FileIndex)
    channels: Channels = field(default_factory=Channels)
    begins: bool = False
    ends: bool = False
    data_end: int = 0
    missing: bytes = b''
    spoilt: list[int] = field(default_factory=list)
    rescued: list[Chunk] = field(default_factory=list)
    torn: bool = False
    chunked: bool = True


@dataclass
class _OpenChunk:
    """The last chunk that was met, while its message indexes follow."""

    place: ChunkPlace
    entries: Entries
    indexes: dict[int, int] = field(default_factory=dict)
    end: int = 0


def scan_file(path: Path) -> FileScan:
    """Look through a file, chunk by chunk.

    Raises:
        BagError: If it begins unlike an mcap file.
        OSError: If it can't be read.
    """
    return _Scanner().scan(path)


class _Scanner:
    def __init__(self) -> None:
        self._result = FileScan()
        self._chunk: _OpenChunk | None = None

    def scan(self, path: Path) -> FileScan:
        result, end, in_data = self._result, FileEnd(), True
        with path.open('rb') as stream:
            for opcode, offset, body in file_records(stream, end):
                in_data = in_data and opcode != Opcode.DATA_END
                if in_data:
                    result.data_end = offset + RECORD_HEAD.size + len(body)
                    try:
                        self._take(opcode, offset, body)
                    except UNPACKING_ERRORS:
                        result.spoilt.append(offset)
                elif opcode in (SCHEMA, CHANNEL):  # the old summary repeats them
                    result.channels.learn(opcode, body)
                    result.index.learn(opcode, body)
            result.torn = in_data and stream.seek(0, 2) > result.data_end
        self._end_chunk(last=True)
        self._name_unknown_channels()
        result.ends = end.whole and not result.spoilt
        return result

    def _take(self, opcode: int, offset: int, body: memoryview) -> None:
        """Take in one record of the data."""
        result, length = self._result, RECORD_HEAD.size + len(body)
        if opcode == Opcode.MESSAGE_INDEX:
            if self._chunk is not None:
                self._chunk.indexes[int.from_bytes(body[:2], 'little')] = offset
                self._chunk.end = offset + length
            return
        self._end_chunk()
        if opcode == CHUNK:
            self._take_chunk(offset, body)
        elif opcode == MESSAGE and len(body) >= MESSAGE_HEAD.size:
            channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(body)
            result.index.add_messages(channel, 1, log_ns, log_ns)
            result.chunked = False
        elif opcode == METADATA:
            result.index.add_note(offset, length, note_of(body)[0])
        elif opcode == Opcode.ATTACHMENT:
            result.index.add_attachment(offset, length, body)
        else:
            result.begins |= opcode == Opcode.HEADER
            result.channels.learn(opcode, body)
            result.index.learn(opcode, body)

    def _take_chunk(self, offset: int, body: memoryview) -> None:
        """Take in a chunk, or what can be unpacked of it.

        Raises:
            One of UNPACKING_ERRORS, if that isn't all.
        """
        index, entries = self._result.index, Entries()
        sound: list[tuple[int, memoryview]] = []
        at = 0
        try:
            for opcode, part in chunk_records(body):
                if opcode == MESSAGE:
                    channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(part)
                    entries.setdefault(channel, []).extend((log_ns, at))
                else:
                    self._result.channels.learn(opcode, part)
                    index.learn(opcode, part)
                sound.append((opcode, part))
                at += RECORD_HEAD.size + len(part)
        except UNPACKING_ERRORS:
            self._result.rescued.append(_gathered(sound))
            raise
        for channel, flat in entries.items():
            times = flat[::2]
            index.add_messages(channel, len(times), min(times), max(times))
        first_ns, last_ns, size, _ = CHUNK_HEAD.unpack_from(body)
        compression, start = text_at(body, CHUNK_HEAD.size)
        length, packed = RECORD_HEAD.size + len(body), len(body) - start - 8
        place = ChunkPlace(first_ns, last_ns, offset, length, {}, 0, compression, packed, size)
        self._chunk = _OpenChunk(place, entries, end=offset + length)

    def _end_chunk(self, last: bool = False) -> None:
        """Take the last chunk in, with the message indexes that followed it."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        place, indexes = chunk.place, chunk.indexes
        start = place.offset + place.length
        indexes_length = chunk.end - start
        if last and not chunk.entries.keys() <= indexes.keys():
            self._result.missing, indexes = message_indexes(chunk.entries, start)
            indexes_length = len(self._result.missing)
            self._result.data_end = start
            self._result.torn = False  # what follows was only part of an index
        whole = dataclasses.replace(place, indexes=indexes, indexes_length=indexes_length)
        self._result.index.add_chunk(whole)

    def _name_unknown_channels(self) -> None:
        """Give channels that nothing describes any more a name, so that readers get by."""
        index = self._result.index
        for channel in sorted(index.counts.keys() - index.channels.keys()):
            index.learn(CHANNEL, packed_channel(channel, 0, f'/unknown_{channel}', {})[9:])


def _gathered(records: list[tuple[int, memoryview]]) -> Chunk:
    """Return records as a new chunk."""
    chunk = Chunk()
    for opcode, body in records:
        if opcode == MESSAGE:
            channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(body)
            chunk.add(channel, sequence, log_ns, publish_ns, bytes(body[MESSAGE_HEAD.size :]))
        else:
            chunk.add_record(packed_record(opcode, bytes(body)))
    return chunk
