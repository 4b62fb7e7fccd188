"""The records of an mcap file that carry topics and messages, as bytes and back.

Only what reading a damaged file needs: mcap's own reader wants a whole one.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BufferedReader

import lz4.frame
import zstandard

from layered_cbf_ros.bags.storage.topic import Topic
from layered_cbf_ros.errors import BagError

MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0C
RECORD_HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
CHUNK_HEAD = struct.Struct('<QQQI')  # first and last log time, size, checksum
UNPACKING_ERRORS = (struct.error, RuntimeError, zstandard.ZstdError, BagError, UnicodeDecodeError)


class FileEnd:
    """How the records of a file ended: `whole` is False if there is something missing."""

    def __init__(self) -> None:
        self.whole = False


def file_records(stream: BufferedReader, end: FileEnd) -> Iterator[tuple[int, int, memoryview]]:
    """Yield opcode, offset and body of each whole record up to the footer.

    Args:
        stream: A file, at its beginning.
        end: Told whether the footer was found, and the magic behind it.

    Raises:
        BagError: If it begins unlike an mcap file.
    """
    size = stream.seek(0, 2)
    stream.seek(0)
    if not MAGIC.startswith(stream.read(len(MAGIC))):
        raise BagError(f'{stream.name} is no mcap file')
    while True:
        offset = stream.tell()
        head = stream.read(RECORD_HEAD.size)
        if len(head) < RECORD_HEAD.size:
            return
        opcode, length = RECORD_HEAD.unpack(head)
        if opcode == 0 or length > size - offset - RECORD_HEAD.size:
            return
        body = memoryview(stream.read(length))
        if opcode == FOOTER:
            end.whole = stream.read(len(MAGIC)) == MAGIC
            return
        yield opcode, offset, body


def chunk_records(body: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and body of the records of a chunk.

    Raises:
        One of UNPACKING_ERRORS, if the chunk is spoilt.
    """
    data = memoryview(_unpacked(body))
    at = 0
    while at + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        at += RECORD_HEAD.size
        if length > len(data) - at:
            raise BagError('a record is longer than its chunk')
        yield opcode, data[at : at + length]
        at += length


def _unpacked(body: memoryview) -> bytes | memoryview:
    """Return the records of a chunk, decompressed."""
    _, _, size, _ = CHUNK_HEAD.unpack_from(body)
    compression, at = text_at(body, CHUNK_HEAD.size)
    packed = body[at + 8 :]
    if compression == '':
        data: bytes | memoryview = packed
    elif compression == 'lz4':
        data = lz4.frame.decompress(packed)
    elif compression == 'zstd':
        data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    else:
        raise BagError(f"chunk compression '{compression}' is unknown")
    if len(data) != size:
        raise BagError(f'chunk has {len(data)} bytes instead of {size}')
    return data


class Channels:
    """The topics of one file, by their numbers in it; they stand before their messages."""

    def __init__(self) -> None:
        self.topics: dict[int, Topic] = {}
        self._schemas: dict[int, tuple[str, str, str]] = {}

    def learn(self, opcode: int, body: memoryview) -> None:
        """Take note of a record, if it is a schema's or a channel's."""
        if opcode == SCHEMA:
            name, at = text_at(body, 2)
            encoding, at = text_at(body, at)
            definition, _ = text_at(body, at)
            self._schemas[int.from_bytes(body[:2], 'little')] = name, definition, encoding
        elif opcode == CHANNEL:
            channel, schema = struct.unpack_from('<HH', body)
            name, at = text_at(body, 4)
            _, at = text_at(body, at)
            more = texts_at(body, at)
            self.topics[channel] = Topic(
                name,
                *self._schemas.get(schema, ('', '', '')),
                more.get('topic_type_hash', ''),
                more.get('offered_qos_profiles', ''),
            )


def note_of(body: memoryview) -> tuple[str, dict[str, str]]:
    """Return the name and the entries of a Metadata record."""
    name, at = text_at(body, 0)
    return name, texts_at(body, at)


def text_at(body: memoryview, at: int) -> tuple[str, int]:
    """Return the length-prefixed string at an offset, and the offset behind it.

    Raises:
        BagError: If it is longer than the record.
    """
    start = at + 4
    end = start + int.from_bytes(body[at:start], 'little')
    if end > len(body):
        raise BagError('a text is longer than its record')
    return str(body[start:end], 'utf-8'), end


def texts_at(body: memoryview, at: int) -> dict[str, str]:
    """Return the map of strings at an offset."""
    end = at + 4 + int.from_bytes(body[at : at + 4], 'little')
    at += 4
    entries: dict[str, str] = {}
    while at < end:
        key, at = text_at(body, at)
        entries[key], at = text_at(body, at)
    return entries
