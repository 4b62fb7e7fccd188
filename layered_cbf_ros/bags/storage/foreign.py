"""Bags that others recorded in other files than mcap: read by rosbags."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.metadata import dump_qos_v9

from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError

FORMATS = {MessageDefinitionFormat.MSG: 'ros2msg', MessageDefinitionFormat.IDL: 'ros2idl'}


class ForeignBag(Bag):
    """A bag in whatever form rosbags reads: sqlite3, or compressed files."""

    def __init__(self, path: Path) -> None:
        """Look into the bag.

        Args:
            path: A folder with metadata.yaml, or a db3 file.

        Raises:
            BagError: If rosbags can't read it.
        """
        files = (
            [path] if path.is_file() else sorted(path.glob('*.db3*')) + sorted(path.glob('*.mcap*'))
        )
        super().__init__(path, tuple(files))
        with self._opened() as reader:
            self._topics = {c.topic: _topic(c) for c in reader.connections}
            first_ns, end_ns = reader.start_time, reader.end_time
            self._span_ns = (first_ns, end_ns - 1) if reader.message_count else (0, 0)

    @property
    def topics(self) -> dict[str, Topic]:
        """Return the topics by name."""
        return self._topics

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return first and last log time [ns], see Bag."""
        return self._span_ns

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield messages in the order of the files, see Bag."""
        return self.in_time_order(topics)

    def in_time_order(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Yield messages in the order of their log times, see Bag."""
        self._begin_pass()
        with self._opened() as reader:
            for connection, log_ns, data in reader.messages(start=start_ns):
                self._count(connection.topic, log_ns)
                if topics is None or connection.topic in topics:
                    yield Record(self._topics[connection.topic], log_ns, log_ns, bytes(data))

    @contextmanager
    def _opened(self) -> Iterator[Reader]:
        """Open the bag; turn what rosbags says of a bad one into one line."""
        try:
            with Reader(self.path) as reader:
                yield reader
        except (ReaderError, OSError, sqlite3.Error, ValueError) as error:
            reason = str(error).partition('\n')[0]
            raise BagError(f'{self.path} cannot be read: {reason}') from None


def _topic(connection: Connection) -> Topic:
    extension = connection.ext
    assert isinstance(extension, ConnectionExtRosbag2)
    return Topic(
        connection.topic,
        connection.msgtype,
        connection.msgdef.data,
        FORMATS.get(connection.msgdef.format, ''),
        connection.digest,
        str(yaml.safe_dump(dump_qos_v9(extension.offered_qos_profiles), sort_keys=False)),
    )
