"""Finishes bags that were cut off: every whole chunk and message is kept, and found again.

A file is repaired where it is, without a copy: nothing that can be read is moved, so
nothing is lost should the repair be cut off too, and it needs hardly any room.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from layered_cbf_ros.bags.storage.bag_folder import replace_file
from layered_cbf_ros.bags.storage.chunk import compressor
from layered_cbf_ros.bags.storage.file_scan import FileScan, scan_file
from layered_cbf_ros.bags.storage.mcap_packing import PRIVATE, packed_beginning
from layered_cbf_ros.bags.storage.mcap_records import RECORD_HEAD
from layered_cbf_ros.bags.storage.metadata import (
    INFORMATION,
    METADATA_FILE,
    FilePart,
    RecordedTopic,
    metadata_text,
)
from layered_cbf_ros.bags.storage.presets import PRESETS
from layered_cbf_ros.bags.storage.reader import find_mcap_files
from layered_cbf_ros.errors import BagError

KEPT = ('compression_format', 'compression_mode', 'custom_data', 'ros_distro')
"""Entries of metadata.yaml that can't be found in the files."""


@dataclass(frozen=True, slots=True)
class FileRepair:
    """What became of one file.

    Attributes:
        name: Its name.
        was_whole: Whether there was nothing to do.
        messages: How many it holds.
        set_aside: Bytes that are of no use: kept, but no reader looks at them any more.
    """

    name: str
    was_whole: bool
    messages: int
    set_aside: int


@dataclass(frozen=True, slots=True)
class RepairReport:
    """What became of a bag.

    Attributes:
        path: The bag.
        files: Its files.
        metadata_written: Whether metadata.yaml was missing or wrong, and is now right.
    """

    path: Path
    files: tuple[FileRepair, ...]
    metadata_written: bool

    @property
    def changed(self) -> bool:
        """Return whether anything was done."""
        return self.metadata_written or not all(file.was_whole for file in self.files)

    def lines(self) -> list[str]:
        """Say in words what was done."""
        if not self.changed:
            return [f'{self.path} is whole; nothing was changed']
        lines = []
        for file in self.files:
            state = 'was whole' if file.was_whole else 'was cut off, has its index now'
            aside = f', {file.set_aside} bytes of no use set aside' if file.set_aside else ''
            lines.append(f'{file.name}: {file.messages} messages, {state}{aside}')
        if self.metadata_written:
            lines.append(f'{METADATA_FILE}: written anew')
        return lines


def repair(path: Path, force: bool = False) -> RepairReport:
    """Give a bag the index and the metadata that it lacks; leave a whole one untouched.

    Args:
        path: An mcap file, a bag's folder, or a run's folder with the bag in bag/.
        force: Do it even if some process holds the bag as its recorder does.

    Raises:
        BagError: If there is no mcap file, it is being recorded, or can't be written.
    """
    files = find_mcap_files(path)
    folder = files[0].parent
    alone = path.is_file() and not (folder / METADATA_FILE).exists()
    if path.is_file() and not alone:
        files = find_mcap_files(folder)
    repairs, parts, topics = [], [], dict[str, RecordedTopic]()
    for file in files:
        try:
            done, scan = _repair_file(file, force)
        except OSError as error:
            raise BagError(
                f'{file} cannot be repaired: {error.strerror}; make room or give yourself the '
                'right to write it; what could be read before still can'
            ) from None
        repairs.append(done)
        index = scan.index
        parts.append(FilePart(file.name, index.first_ns, index.last_ns, index.count))
        _count_topics(topics, scan)
    written = not alone and _renew_metadata(folder, parts, topics)
    return RepairReport(folder if not alone else path, tuple(repairs), written)


def _repair_file(path: Path, force: bool) -> tuple[FileRepair, FileScan]:
    """Repair one file, if it needs it.

    Raises:
        BagError: If it is no mcap file, or being recorded.
        OSError: If it can't be read or written.
    """
    scan = scan_file(path)
    if scan.ends:
        return FileRepair(path.name, True, scan.index.count, 0), scan
    descriptor = os.open(path, os.O_RDWR)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if not force:
                raise BagError(
                    f'{path} is being recorded; end the recorder first (or give --force)'
                ) from None
        scan = scan_file(path)  # nobody writes it any more
        aside = _set_aside(descriptor, scan)
        _append_index(descriptor, scan)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    return FileRepair(path.name, False, scan.index.count, aside), scan


def _set_aside(descriptor: int, scan: FileScan) -> int:
    """Make readers step over what is spoilt or torn; return how many bytes that is."""
    aside = 0
    for offset in scan.spoilt:
        opcode, length = RECORD_HEAD.unpack(os.pread(descriptor, RECORD_HEAD.size, offset))
        os.pwrite(descriptor, bytes((PRIVATE | opcode,)), offset)
        aside += RECORD_HEAD.size + length
    rest = os.fstat(descriptor).st_size - scan.data_end
    if not scan.begins and not scan.index.count:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, packed_beginning(), 0)
    elif scan.torn and rest >= RECORD_HEAD.size:
        head = RECORD_HEAD.pack(PRIVATE, rest - RECORD_HEAD.size)
        os.pwrite(descriptor, head, scan.data_end)
        aside += rest
    else:
        os.ftruncate(descriptor, scan.data_end)
    return aside


def _append_index(descriptor: int, scan: FileScan) -> None:
    """Write what the file lacks behind its data, or, if there is no room, nothing."""
    start = at = os.fstat(descriptor).st_size
    try:
        for data in _lacking(scan, start):
            left = memoryview(data)
            while left:
                done = os.pwrite(descriptor, left, at)
                left, at = left[done:], at + done
    except OSError:
        os.ftruncate(descriptor, start)
        raise


def _lacking(scan: FileScan, at: int) -> Sequence[bytes]:
    """Return what the file lacks, to be written from an offset on."""
    parts = [scan.missing]
    at += len(scan.missing)
    preset = PRESETS['none']
    for chunk in scan.rescued:
        if chunk.size:
            data, place = chunk.pack(at, preset, compressor(preset))
            scan.index.add_chunk(place)
            for channel, span in chunk.spans().items():
                scan.index.add_messages(channel, *span)
            parts.append(data)
            at += len(data)
    return [*parts, scan.index.ending(at, scan.chunked)]


def _count_topics(topics: dict[str, RecordedTopic], scan: FileScan) -> None:
    """Add the topics of one file, and how many messages each has."""
    for channel, topic in scan.channels.topics.items():
        known = topics.setdefault(
            topic.name, RecordedTopic(topic.name, topic.type_name, topic.type_hash, topic.qos)
        )
        known.count += scan.index.counts[channel]


def _renew_metadata(
    folder: Path, parts: Sequence[FilePart], topics: dict[str, RecordedTopic]
) -> bool:
    """Write metadata.yaml, unless what it tells is right; return whether it was written."""
    path = folder / METADATA_FILE
    old: dict[str, Any] = {}
    try:
        old = dict(yaml.safe_load(path.read_text(encoding='utf-8'))[INFORMATION])
        if _told(old) == _found(parts, topics):
            return False
        silent = [entry['topic_metadata'] for entry in old['topics_with_message_count']]
        for entry in silent:
            qos = entry.get('offered_qos_profiles') or []
            text = qos if isinstance(qos, str) else yaml.safe_dump(qos, sort_keys=False)
            type_hash = entry.get('type_description_hash', '')
            topic = RecordedTopic(entry['name'], entry['type'], type_hash, text)
            topics.setdefault(topic.name, topic)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError):
        pass  # it is missing or spoilt: what the files tell is enough
    kept = {key: old[key] for key in KEPT if key in old}
    text = metadata_text(parts, list(topics.values()), kept=kept)
    try:
        replace_file(str(path), text)
    except OSError as error:
        raise BagError(f'{path} cannot be written: {error.strerror}; make room') from None
    return True


def _told(old: dict[str, Any]) -> tuple[object, ...]:
    """Return what metadata.yaml tells of files and messages."""
    counts = {
        entry['topic_metadata']['name']: entry['message_count']
        for entry in old['topics_with_message_count']
        if entry['message_count']
    }
    return [Path(name).name for name in old['relative_file_paths']], counts


def _found(parts: Sequence[FilePart], topics: dict[str, RecordedTopic]) -> tuple[object, ...]:
    """Return the same as the files tell it."""
    counts = {topic.name: topic.count for topic in topics.values() if topic.count}
    return [part.name for part in parts], counts
