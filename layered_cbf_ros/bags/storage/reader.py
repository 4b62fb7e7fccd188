"""Reads bags by streaming through them, so that a bag cut off anywhere gives what is whole."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from layered_cbf_ros.errors import BagError

MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06
RECORD_HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
CHUNK_HEAD = struct.Struct('<QQQI')


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic found in a bag, with the definition that the bag carries."""

    name: str
    type_name: str
    definition: str


@dataclass(frozen=True, slots=True)
class Record:
    """One message as it stands in the bag.

    Attributes:
        topic: Where it was sent.
        log_time_ns, publish_time_ns: When it was recorded and sent [ns].
        data: CDR bytes.
    """

    topic: Topic
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class BagReader:
    """Streams one bag, as often as asked.

    It never uses the index at the end of a file. After a pass the attributes tell
    what was found; before, they are empty.

    Attributes:
        truncated: True if a file ends before its footer, or a chunk is spoilt.
        counts: Messages by topic, including topics that weren't asked for.
        log_span_ns: First and last log time [ns]; zeros if there is no message.
    """

    def __init__(self, path: Path) -> None:
        """Find the files.

        Args:
            path: An mcap file, a bag's folder, or a run's folder with the bag in bag/.

        Raises:
            BagError: If there is no mcap file.
        """
        self.files = _find_files(path)
        self.truncated = False
        self.counts: dict[str, int] = {}
        self.log_span_ns = (0, 0)

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield messages in the order of the file.

        Args:
            topics: Names of those wanted; None for all.

        Raises:
            BagError: If a file is no mcap file.
        """
        self.truncated, self.counts, self.log_span_ns = False, {}, (0, 0)
        for path in self.files:
            channels: dict[int, Topic] = {}
            for channel, message in self._messages(path, channels):
                _, _, log_time_ns, publish_time_ns = MESSAGE_HEAD.unpack_from(message)
                topic = channels[channel]
                self._count(topic.name, log_time_ns)
                if topics is None or topic.name in topics:
                    data = bytes(message[MESSAGE_HEAD.size :])
                    yield Record(topic, log_time_ns, publish_time_ns, data)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[Record, Any]]:
        """Yield records together with the decoded message, as rosbags decodes it.

        Raises:
            BagError: If a message can't be decoded, or a file is no mcap file.
        """
        decoder = MessageDecoder()
        for record in self.records(topics):
            yield record, decoder.decode(record)

    def _count(self, topic: str, log_time_ns: int) -> None:
        first, last = self.log_span_ns if self.counts else (log_time_ns, log_time_ns)
        self.log_span_ns = (min(first, log_time_ns), max(last, log_time_ns))
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def _messages(self, path: Path, channels: dict[int, Topic]) -> Iterator[tuple[int, memoryview]]:
        """Yield channel id and body of each message; learn the channels on the way."""
        schemas: dict[int, tuple[str, str]] = {}
        with path.open('rb') as stream:
            for opcode, body in self._file_records(path, stream):
                parts = iter([(opcode, body)]) if opcode != CHUNK else self._chunk_records(body)
                for kind, part in parts:
                    if kind == MESSAGE:
                        channel = int.from_bytes(part[:2], 'little')
                        if channel in channels:
                            yield channel, part
                    elif kind == SCHEMA:
                        _learn_schema(part, schemas)
                    elif kind == CHANNEL:
                        _learn_channel(part, schemas, channels)
                if self.truncated:
                    return

    def _file_records(self, path: Path, stream: BufferedReader) -> Iterator[tuple[int, memoryview]]:
        """Yield the whole records of a file; note if it ends before its footer."""
        size = path.stat().st_size
        magic = stream.read(len(MAGIC))
        if not MAGIC.startswith(magic):
            raise BagError(f'{path} is no mcap file')
        while True:
            head = stream.read(RECORD_HEAD.size)
            if len(head) < RECORD_HEAD.size:
                break
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode == 0 or length > size - stream.tell():
                break
            body = memoryview(stream.read(length))
            if opcode == FOOTER:
                self.truncated |= stream.read(len(MAGIC)) != MAGIC
                return
            yield opcode, body
        self.truncated = True

    def _chunk_records(self, body: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield the records of a chunk; a chunk that can't be unpacked ends the bag."""
        try:
            data = memoryview(_unpack_chunk(body))
        except (struct.error, RuntimeError, zstandard.ZstdError, BagError):
            self.truncated = True
            return
        at = 0
        while at + RECORD_HEAD.size <= len(data):
            opcode, length = RECORD_HEAD.unpack_from(data, at)
            at += RECORD_HEAD.size
            if length > len(data) - at:
                self.truncated = True
                return
            yield opcode, data[at : at + length]
            at += length


class MessageDecoder:
    """Decodes records with rosbags; unknown types come from the bag's own definitions."""

    def __init__(self) -> None:
        self._typestore = get_typestore(Stores.ROS2_JAZZY)

    def decode(self, record: Record) -> Any:
        """Return the message as a rosbags dataclass.

        Raises:
            BagError: If its bytes don't fit its type.
        """
        topic = record.topic
        if topic.type_name not in self._typestore.fielddefs:
            self._typestore.register(get_types_from_msg(topic.definition, topic.type_name))
        try:
            return self._typestore.deserialize_cdr(record.data, topic.type_name)
        except SerdeError as error:
            raise BagError(f'a message of {topic.name} cannot be decoded: {error}') from error


def read_messages(
    path: Path, topics: Collection[str] | None = None
) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, log time [ns] and decoded message of a bag, whole or cut off."""
    for record, message in BagReader(path).messages(topics):
        yield record.topic.name, record.log_time_ns, message


def _find_files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    found = [*path.glob('*.mcap')] or [*(path / 'bag').glob('*.mcap')]
    if not found:
        raise BagError(f'{path} holds no mcap file')
    return sorted(found, key=lambda file: (len(file.name), file.name))


def _unpack_chunk(body: memoryview) -> bytes | memoryview:
    """Return the records of a chunk, decompressed."""
    _, _, size, _ = CHUNK_HEAD.unpack_from(body)
    compression, at = _text(body, CHUNK_HEAD.size)
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


def _learn_schema(body: memoryview, schemas: dict[int, tuple[str, str]]) -> None:
    name, at = _text(body, 2)
    _, at = _text(body, at)
    definition, _ = _text(body, at)
    schemas[int.from_bytes(body[:2], 'little')] = (name, definition)


def _learn_channel(
    body: memoryview, schemas: dict[int, tuple[str, str]], channels: dict[int, Topic]
) -> None:
    channel, schema = struct.unpack_from('<HH', body)
    name, _ = _text(body, 4)
    type_name, definition = schemas.get(schema, ('', ''))
    channels[channel] = Topic(name, type_name, definition)


def _text(body: memoryview, at: int) -> tuple[str, int]:
    """Return the length-prefixed string at an offset, and the offset behind it."""
    start = at + 4
    end = start + int.from_bytes(body[at:start], 'little')
    return str(body[start:end], 'utf-8'), end
