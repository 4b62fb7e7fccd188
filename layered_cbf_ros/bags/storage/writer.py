"""Writes bags as `ros2 bag record -s mcap` does, without ROS."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Collection, Mapping
from pathlib import Path
from types import TracebackType
from typing import NoReturn

from layered_cbf_ros.bags.storage.bag_folder import write_error
from layered_cbf_ros.bags.storage.file_series import FileSeries
from layered_cbf_ros.bags.storage.metadata import (
    METADATA_FILE,
    RecordedTopic,
    metadata_text,
    qos_yaml,
)
from layered_cbf_ros.bags.storage.presets import Storage
from layered_cbf_ros.bags.storage.schemas import load_schema
from layered_cbf_ros.interfaces import NS_PER_S

CHUNKS_PER_FILE = 8  # at least, so that files come out no larger than was asked for
NEVER_NS = 1 << 63
FAILED_NOTE = 'recorder_failed'
"""Name of the note that tells why a recording ended before it was asked to."""


class BagWriter:
    """A bag being written: `<folder>/<name>_0.mcap`, perhaps more, and metadata.yaml.

    Messages are gathered in chunks; whatever happens to the process, every chunk that
    was full, or flushed, can be read.
    """

    def __init__(
        self, folder: Path, compression: str = 'none', storage: Storage | None = None
    ) -> None:
        """Create the folder and both files.

        Args:
            folder: The bag; it must not exist yet, or be empty.
            compression: Name of a preset, if that is all there is to say.
            storage: How the bag is stored.

        Raises:
            BagError: If the folder holds something or can't be written.
        """
        self._storage = storage or Storage(compression)
        self._files = FileSeries(folder, self._storage)
        at_most = self._storage.max_bytes // CHUNKS_PER_FILE or self._storage.chunk_bytes
        self._room = min(self._storage.chunk_bytes, at_most)
        self._topics: list[RecordedTopic] = []
        self._schema_numbers: dict[str, int] = {}
        self._introduced: set[int] = set()
        self._notes: dict[str, dict[str, str]] = {}
        self._metadata_is_due = True
        self._is_open = True
        self._split_ns = 0 if self._storage.max_seconds else NEVER_NS
        self.flush()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return {topic.name: topic.count for topic in self._topics}

    @property
    def path(self) -> str:
        """Return where the bag is now."""
        return self._files.folder.path

    def add_topic(self, topic: str, type_name: str, qos: str | None = None) -> int:
        """Register a topic; return its id for `write`.

        Args:
            topic: Full name.
            type_name: `package/msg/Type`.
            qos: Offered QoS profiles as YAML, see metadata.qos_list.

        Raises:
            BagError: If the type isn't known here.
        """
        schema = load_schema(type_name)
        self._schema_numbers.setdefault(type_name, len(self._schema_numbers) + 1)
        profiles = qos_yaml() if qos is None else qos
        self._topics.append(
            RecordedTopic(topic, type_name, schema.type_hash, profiles, schema.definition)
        )
        self._metadata_is_due = True
        return len(self._topics)

    def set_qos(self, topic_id: int, qos: str) -> bool:
        """Tell what publishers offer by now; return False if it comes too late.

        It is stored with the first chunk, and the same in every file of a bag.
        """
        topic = self._topics[topic_id - 1]
        if topic.qos_yaml == qos:
            return True
        if topic_id in self._introduced:
            return False
        topic.qos_yaml = qos
        self._metadata_is_due = True
        return True

    def write(
        self, topic_id: int, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int = 0
    ) -> None:
        """Append one serialised message.

        Args:
            topic_id: From add_topic.
            data: CDR bytes.
            log_time_ns: When it was received [ns].
            publish_time_ns: When it was sent, its stamp where it has one [ns].
            sequence: Its number as its publisher counts; by default the bag counts.

        Raises:
            BagError: If the disk is full, or the like; all up to the last chunk is safe.
        """
        if log_time_ns >= self._split_ns:
            self._split(log_time_ns)
        topic, chunk = self._topics[topic_id - 1], self._files.current.chunk
        topic.count += 1
        number = (sequence or topic.count) & 0xFFFFFFFF
        if chunk.add(topic_id, number, log_time_ns, publish_time_ns, data) >= self._room:
            self._end_chunk()

    def flush(self) -> None:
        """End the chunk in progress, so that all written so far survives a kill.

        Raises:
            BagError: If the disk is full; all up to the last chunk is safe.
        """
        self._end_chunk()

    def keep(self) -> str:
        """See that nobody has deleted the bag; return what was put back, '' if nothing.

        Raises:
            BagError: If it can't be put back.
        """
        done = self._files.keep()
        if done:
            self._metadata_is_due = True
            self.flush()
        return done

    def note(self, name: str, entries: Mapping[str, str]) -> None:
        """Have texts stored by name and key when the bag is closed."""
        self._notes[name] = dict(entries)

    def close(self, custom_data: Mapping[str, str] | None = None) -> None:
        """Write the index and the final metadata; later calls do nothing.

        Args:
            custom_data: What else metadata.yaml shall tell.

        Raises:
            BagError: If the disk is full; all up to the last chunk is safe.
        """
        if not self._is_open:
            return
        silent = {k for k, topic in enumerate(self._topics, 1) if not topic.count}
        self._end_chunk(also=silent)
        try:
            self._files.finish(self._notes)
            self._write_metadata(custom_data)
        except OSError as error:
            self._give_up(error)
        self._is_open = False
        self._files.close()

    def _end_chunk(self, also: Collection[int] = ()) -> None:
        """Write the chunk in progress; say first what the topics in it are, and others."""
        current = self._files.current
        before = current.size
        for topic_id in sorted({*current.chunk.channels, *also}):
            topic = self._topics[topic_id - 1]
            current.introduce(topic_id, self._schema_numbers[topic.type_name], topic)
            self._introduced.add(topic_id)
        try:
            current.end_chunk()
            if self._metadata_is_due:
                self._write_metadata()
        except OSError as error:
            self._give_up(error)
        if self._storage.max_bytes and 2 * current.size - before > self._storage.max_bytes:
            self._split_ns = 0  # another chunk like this would be too much

    def _split(self, log_time_ns: int) -> None:
        """Go on in another file, unless this one is empty yet."""
        if self._files.current.chunk.size or self._files.current.index.count:
            self._end_chunk()
            try:
                self._files.finish(self._notes)
                self._files.begin_next()
                self._write_metadata()
            except OSError as error:
                self._give_up(error)
        period_ns = round(self._storage.max_seconds * NS_PER_S)
        self._split_ns = log_time_ns + period_ns if period_ns else NEVER_NS

    def _give_up(self, error: OSError) -> NoReturn:
        """Make the best of a disk that takes no more, and tell."""
        unsaved = sum(count for count, _, _ in self._files.current.chunk.spans().values())
        told = write_error(
            self._files.current.path, error, f'{unsaved} messages are not in the bag; '
        )
        self.note(FAILED_NOTE, {'reason': str(told)})
        with contextlib.suppress(OSError):
            self._files.finish(self._notes)
        with contextlib.suppress(OSError):
            self._write_metadata()
        self._is_open = False
        self._files.close()
        raise told from None

    def _write_metadata(self, custom_data: Mapping[str, str] | None = None) -> None:
        """Tell what is on the disk by now."""
        counts = self._files.counts
        topics = [
            dataclasses.replace(topic, count=counts[topic_id])
            for topic_id, topic in enumerate(self._topics, 1)
        ]
        text = metadata_text(self._files.parts, topics, custom_data)
        self._files.folder.replace(METADATA_FILE, text)
        self._metadata_is_due = False
