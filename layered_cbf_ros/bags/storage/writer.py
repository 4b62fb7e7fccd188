"""Writes bags as `ros2 bag record -s mcap` does, without ROS."""

from __future__ import annotations

from io import FileIO
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from layered_cbf_ros.bags.storage.metadata import RecordedTopic, TimeSpan, qos_yaml, write_metadata
from layered_cbf_ros.bags.storage.schemas import load_schema
from layered_cbf_ros.errors import BagError

CHUNK_BYTES = 1 << 20
COMPRESSIONS = {'none': CompressionType.NONE, 'lz4': CompressionType.LZ4}


class _UnbufferedFile:
    """Passes each write on at once, so that a killed writer leaves whole chunks behind."""

    def __init__(self, path: Path) -> None:
        self._file = FileIO(path, 'w')
        self._at = 0

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            left = left[self._file.write(left) :]
        self._at += len(data)
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        """Do nothing: nothing is held back."""

    def close(self) -> None:
        self._file.close()


class BagWriter:
    """A bag being written: `<folder>/<name>_0.mcap` and metadata.yaml.

    Messages are gathered in chunks of 1 MiB; whatever happens to the process,
    every chunk that was full, or flushed, can be read.
    """

    def __init__(self, folder: Path, compression: str = 'none') -> None:
        """Create the folder and both files.

        Args:
            folder: The bag; it must not exist yet, or be empty.
            compression: 'none' or 'lz4', of each chunk.

        Raises:
            BagError: If the folder holds something or can't be written.
        """
        if compression not in COMPRESSIONS:
            raise BagError(f"compression is '{compression}'; choose none or lz4")
        if folder.exists() and any(folder.iterdir()):
            raise BagError(f'{folder} exists already; record into another folder')
        self.folder = folder
        self._file_name = f'{folder.name}_0.mcap'
        self._topics: list[RecordedTopic] = []
        self._schema_ids: dict[str, int] = {}
        self._span = TimeSpan()
        self._is_empty = True
        self._is_open = True
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = _UnbufferedFile(folder / self._file_name)
        except OSError as error:
            raise BagError(f'{folder} cannot be written: {error.strerror}') from error
        self._mcap = Writer(
            self._file,  # type: ignore[arg-type]
            chunk_size=CHUNK_BYTES,
            compression=COMPRESSIONS[compression],
            enable_crcs=False,
        )
        self._mcap.start(profile='ros2', library='layered_cbf_ros')
        self._write_metadata()

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

    def add_topic(self, topic: str, type_name: str, qos: str | None = None) -> int:
        """Register a topic; return its id for `write`.

        Args:
            topic: Full name.
            type_name: `package/msg/Type`.
            qos: Offered QoS profiles as YAML, see metadata.qos_yaml.

        Raises:
            BagError: If msg_schemas doesn't know the type.
        """
        schema = load_schema(type_name)
        profiles = qos_yaml() if qos is None else qos
        if type_name not in self._schema_ids:
            self._schema_ids[type_name] = self._mcap.register_schema(
                type_name, 'ros2msg', schema.definition.encode()
            )
        channel_metadata = {
            'offered_qos_profiles': profiles,
            'topic_type_hash': schema.type_hash,
        }
        channel = self._mcap.register_channel(
            topic, 'cdr', self._schema_ids[type_name], channel_metadata
        )
        self._topics.append(RecordedTopic(topic, type_name, schema.type_hash, profiles))
        self._write_metadata()
        return channel

    def write(self, topic_id: int, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append one serialised message.

        Args:
            topic_id: From add_topic.
            data: CDR bytes.
            log_time_ns: When it was received [ns].
            publish_time_ns: When it was sent, its stamp where it has one [ns].
        """
        topic = self._topics[topic_id - 1]
        topic.count += 1
        span = self._span
        span.first_ns = log_time_ns if self._is_empty else min(span.first_ns, log_time_ns)
        span.last_ns = max(span.last_ns, log_time_ns)
        self._is_empty = False
        self._mcap.add_message(topic_id, log_time_ns, data, publish_time_ns, topic.count)

    def flush(self) -> None:
        """End the chunk in progress, so that all written so far survives a kill."""
        self._mcap.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Write the index and the final metadata; later calls do nothing."""
        if not self._is_open:
            return
        self._is_open = False
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        self._write_metadata()

    def _write_metadata(self) -> None:
        write_metadata(self.folder, self._file_name, self._topics, self._span)
