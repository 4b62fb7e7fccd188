"""One mcap file being written: whole up to its last chunk, whatever happens."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping

from layered_cbf_ros.bags.storage.bag_folder import path_of
from layered_cbf_ros.bags.storage.chunk import Chunk, compressor
from layered_cbf_ros.bags.storage.file_index import FileIndex
from layered_cbf_ros.bags.storage.mcap_packing import (
    packed_beginning,
    packed_channel,
    packed_note,
    packed_schema,
)
from layered_cbf_ros.bags.storage.mcap_records import CHANNEL, RECORD_HEAD, SCHEMA
from layered_cbf_ros.bags.storage.metadata import FilePart, RecordedTopic
from layered_cbf_ros.bags.storage.presets import Preset


class McapFile:
    """Writes chunks, each in one go; one that doesn't fit on the disk is taken back.

    Attributes:
        name: Its name in the folder of the bag.
        index: What it holds.
        chunk: The chunk in progress.
        size: Bytes on the disk.
        is_finished: Whether it has its index.
    """

    def __init__(self, name: str, descriptor: int, preset: Preset) -> None:
        """Begin the file.

        Args:
            name: Its name.
            descriptor: An empty file, open to write.
            preset: How chunks are stored.

        Raises:
            OSError: If it can't be written.
        """
        self.name = name
        self.descriptor = descriptor
        self.index = FileIndex()
        self.chunk = Chunk()
        self.size = 0
        self.is_finished = False
        self._introductions: list[bytes] = []
        self._preset = preset
        self._compress: Callable[[bytes], bytes] = compressor(preset)
        self._append(packed_beginning())

    def introduce(self, number: int, schema: int, topic: RecordedTopic) -> None:
        """Tell, before the next chunk, what a topic is, unless this file tells it already.

        Args:
            number: Of its channel.
            schema: Number of its type.
            topic: The topic.
        """
        if number in self.index.channels:
            return
        if schema not in self.index.schemas:
            self._teach(SCHEMA, packed_schema(schema, topic.type_name, topic.definition))
        entries = {'offered_qos_profiles': topic.qos_yaml, 'topic_type_hash': topic.type_hash}
        self._teach(CHANNEL, packed_channel(number, schema, topic.name, entries))

    def end_chunk(self) -> None:
        """Write the chunk in progress and begin another.

        Raises:
            OSError: If it doesn't fit; the file is then as it was before.
        """
        told = b''.join(self._introductions)
        data, place = self.chunk.pack(self.size + len(told), self._preset, self._compress)
        self._append(told + data if self.chunk.size else told)
        self._introductions = []
        if not self.chunk.size:
            return
        self.index.add_chunk(place)
        for channel, span in self.chunk.spans().items():
            self.index.add_messages(channel, *span)
        self.chunk = Chunk()

    def add_note(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a Metadata record.

        Raises:
            OSError: If it doesn't fit; the file is then as it was before.
        """
        data = packed_note(name, entries)
        self._append(data)
        self.index.add_note(self.size - len(data), len(data), name)

    def finish(self) -> None:
        """Write the index; after that, nothing.

        Raises:
            OSError: If it doesn't fit; the file is then as it was before.
        """
        self._append(self.index.ending(self.size))
        self.is_finished = True

    def close(self) -> None:
        """Let the file go."""
        os.close(self.descriptor)

    @property
    def path(self) -> str:
        """Return where the file is now."""
        return path_of(self.descriptor)

    @property
    def part(self) -> FilePart:
        """Return what metadata.yaml tells of the file."""
        return FilePart(self.name, self.index.first_ns, self.index.last_ns, self.index.count)

    def _teach(self, opcode: int, record: bytes) -> None:
        self._introductions.append(record)
        self.index.learn(opcode, record[RECORD_HEAD.size :])

    def _append(self, data: bytes) -> None:
        """Write all of it, or take back what was written: the file ends with a whole record."""
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self.descriptor, left) :]
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self.descriptor, self.size)
                os.lseek(self.descriptor, self.size, os.SEEK_SET)
            raise
        self.size += len(data)
