"""Reads mcap bags by streaming through them: one cut off anywhere gives what is whole."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from io import BufferedReader
from itertools import takewhile
from operator import itemgetter
from pathlib import Path

from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.mcap_records import (
    CHUNK,
    MESSAGE,
    MESSAGE_HEAD,
    METADATA,
    RECORD_HEAD,
    UNPACKING_ERRORS,
    Channels,
    FileEnd,
    chunk_records,
    file_records,
    note_of,
)
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError

Place = tuple[int, int, int, int]  # log time [ns], file, offset and number in the chunk


@dataclass(frozen=True, slots=True, order=True)
class _Stretch:
    """Where messages stand: a chunk, or one message outside of chunks.

    Attributes:
        first_ns, last_ns: Log times [ns].
        file, offset: Number of the file, and of its byte.
    """

    first_ns: int
    last_ns: int
    file: int
    offset: int


@dataclass
class _Scan:
    """What one look at every file found.

    Attributes:
        stretches: Those that can be read, by time.
        channels: The topics of each file.
        truncated, notes, went_back_ns: As in Bag.
    """

    stretches: list[_Stretch] = field(default_factory=list)
    channels: list[Channels] = field(default_factory=list)
    truncated: bool = False
    notes: dict[str, dict[str, str]] = field(default_factory=dict)
    went_back_ns: dict[str, int] = field(default_factory=dict)


class BagReader(Bag):
    """Streams one bag of mcap files.

    It never trusts the index at the end of a file, which a damaged one lacks.
    """

    def __init__(self, path: Path) -> None:
        """Find the files.

        Args:
            path: An mcap file, a bag's folder, or a run's folder with the bag in bag/.

        Raises:
            BagError: If there is no mcap file.
        """
        super().__init__(path, find_mcap_files(path))
        self._scan: _Scan | None = None
        self._passed: list[Channels] = []

    @property
    def topics(self) -> dict[str, Topic]:
        """Return the topics by name; unless a pass was made, this looks through the bag."""
        channels = self._passed or self._scanned().channels
        return {topic.name: topic for part in channels for topic in part.topics.values()}

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return first and last log time [ns], see Bag."""
        stretches = self._scanned().stretches
        return (
            min((stretch.first_ns for stretch in stretches), default=0),
            max((stretch.last_ns for stretch in stretches), default=0),
        )

    @property
    def went_back_ns(self) -> dict[str, int]:
        """Return by how much log times go back, see Bag."""
        return self._scanned().went_back_ns

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield messages in the order of the files, see Bag."""
        self._begin_pass()
        passed = []
        for path in self.files:
            channels = Channels()
            for opcode, _, body in self._whole_records(path):
                for topic, message in self._messages(opcode, body, channels):
                    yield from self._wanted(topic, message, topics)
            passed.append(channels)
        self._passed = passed

    def in_time_order(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Yield messages in the order of their log times, see Bag.

        A chunk is unpacked when the first of its messages is due, so that only chunks
        that overlap in time are in memory together.
        """
        scan = self._scanned()
        self._begin_pass()
        self.truncated, self.notes = scan.truncated, scan.notes
        waiting: list[tuple[Place, Topic, memoryview]] = []
        streams = [path.open('rb') for path in self.files]
        try:
            for stretch in scan.stretches:
                if start_ns is not None and stretch.last_ns < start_ns:
                    continue
                due = list(takewhile(lambda e, s=stretch: e[0][0] < s.first_ns, waiting))  # type: ignore[misc]
                for _, topic, message in due:
                    yield from self._wanted(topic, message, topics, start_ns)
                del waiting[: len(due)]
                channels = scan.channels[stretch.file]
                waiting += self._unpacked(stretch, streams[stretch.file], channels)
                waiting.sort(key=itemgetter(0))
            for _, topic, message in waiting:
                yield from self._wanted(topic, message, topics, start_ns)
        finally:
            for stream in streams:
                stream.close()

    def _wanted(
        self,
        topic: Topic,
        message: memoryview,
        topics: Collection[str] | None,
        start_ns: int | None = None,
    ) -> Iterator[Record]:
        """Count a message, and yield it if it was asked for."""
        _, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(message)
        if start_ns is not None and log_ns < start_ns:
            return
        self._count(topic.name, log_ns)
        if topics is None or topic.name in topics:
            yield Record(topic, log_ns, publish_ns, bytes(message[MESSAGE_HEAD.size :]), sequence)

    def _unpacked(
        self, stretch: _Stretch, stream: BufferedReader, channels: Channels
    ) -> Iterator[tuple[Place, Topic, memoryview]]:
        """Yield the messages of a stretch with what they are sorted by."""
        stream.seek(stretch.offset)
        opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        body = memoryview(stream.read(length))
        for k, (topic, message) in enumerate(self._messages(opcode, body, channels)):
            log_ns = MESSAGE_HEAD.unpack_from(message)[2]
            yield (log_ns, stretch.file, stretch.offset, k), topic, message

    def _scanned(self) -> _Scan:
        """Look through the files once: which topics there are, and what stands where."""
        if self._scan is None:
            scan, self.truncated = _Scan(), False
            newest_ns: dict[str, int] = {}
            for number, path in enumerate(self.files):
                channels = Channels()
                for opcode, offset, body in self._whole_records(path):
                    times = []
                    for topic, message in self._messages(opcode, body, channels):
                        times.append(log_ns := MESSAGE_HEAD.unpack_from(message)[2])
                        back_ns = newest_ns.get(topic.name, log_ns) - log_ns
                        if back_ns > 0:
                            before_ns = scan.went_back_ns.get(topic.name, 0)
                            scan.went_back_ns[topic.name] = max(back_ns, before_ns)
                        newest_ns[topic.name] = max(newest_ns.get(topic.name, log_ns), log_ns)
                    if times:
                        scan.stretches.append(_Stretch(min(times), max(times), number, offset))
                scan.channels.append(channels)
            scan.stretches.sort()
            scan.truncated, scan.notes = self.truncated, self.notes
            self._scan = scan
        return self._scan

    def _whole_records(self, path: Path) -> Iterator[tuple[int, int, memoryview]]:
        """Yield the records of a file that are whole; take note if there is something missing."""
        end = FileEnd()
        with path.open('rb') as stream:
            for opcode, offset, body in file_records(stream, end):
                if opcode == METADATA:
                    self._take_note(body)
                yield opcode, offset, body
        self.truncated |= not end.whole

    def _take_note(self, body: memoryview) -> None:
        """Keep what a Metadata record says, if it isn't spoilt."""
        try:
            name, self.notes[name] = note_of(body)
        except UNPACKING_ERRORS:
            self.truncated = True

    def _messages(
        self, opcode: int, body: memoryview, channels: Channels
    ) -> Iterator[tuple[Topic, memoryview]]:
        """Yield topic and body of each message in a record; learn the topics on the way.

        What can't be unpacked is left out, and the bag is no longer whole.
        """
        try:
            parts = iter([(opcode, body)]) if opcode != CHUNK else chunk_records(body)
            for kind, part in parts:
                if kind == MESSAGE:
                    topic = channels.topics.get(int.from_bytes(part[:2], 'little'))
                    if topic is not None and len(part) >= MESSAGE_HEAD.size:
                        yield topic, part
                else:
                    channels.learn(kind, part)
        except UNPACKING_ERRORS:
            self.truncated = True


def find_mcap_files(path: Path) -> tuple[Path, ...]:
    """Return the mcap files of a bag, in their order.

    Raises:
        BagError: If there is none.
    """
    if path.is_file():
        return (path,)
    found = [*path.glob('*.mcap')] or [*(path / 'bag').glob('*.mcap')]
    if not found:
        raise BagError(f'{path} holds no mcap file')
    return tuple(sorted(found, key=lambda file: (len(file.name), file.name)))
