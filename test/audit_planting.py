"""Copies of a bag with something planted: messages edited, left out, repeated or swapped.

mcap and rosbags do all the work, so that no code under test touches what is planted.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
MS = 1_000_000


@dataclass(frozen=True)
class Entry:
    """One message of a bag.

    Attributes:
        topic, type_name, definition, qos: Of its channel.
        log_ns, sent_ns: Wall times [ns].
        data: CDR bytes.
    """

    topic: str
    type_name: str
    definition: bytes
    qos: dict[str, str]
    log_ns: int
    sent_ns: int
    data: bytes

    def message(self):
        """Return it decoded."""
        return STORE.deserialize_cdr(self.data, self.type_name)

    def stamp_ns(self) -> int:
        """Return the stamp that it begins with [ns]."""
        seconds, nanoseconds = struct.unpack_from('<iI', self.data, 4)
        return seconds * 1000 * MS + nanoseconds

    def with_message(self, message) -> Entry:
        """Return it with another content."""
        return replace(self, data=bytes(STORE.serialize_cdr(message, self.type_name)))


Change = Callable[[list[Entry]], list[Entry]]


def read(bag: Path) -> list[Entry]:
    """Return all messages of a bag's folder in the order of the file."""
    (path,) = bag.glob('*.mcap')
    with path.open('rb') as stream:
        return [
            Entry(
                channel.topic,
                schema.name,
                schema.data,
                dict(channel.metadata),
                message.log_time,
                message.publish_time,
                message.data,
            )
            for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def write(
    folder: Path, entries: list[Entry], notes: dict[str, dict[str, str]] | None = None
) -> Path:
    """Write a bag of one file without metadata.yaml; return its folder."""
    folder.mkdir()
    with (folder / 'planted_0.mcap').open('wb') as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(profile='ros2', library='test')
        channels: dict[str, int] = {}
        for entry in entries:
            if entry.topic not in channels:
                schema = writer.register_schema(entry.type_name, 'ros2msg', entry.definition)
                channels[entry.topic] = writer.register_channel(
                    entry.topic, 'cdr', schema, entry.qos
                )
            channel = channels[entry.topic]
            writer.add_message(channel, entry.log_ns, entry.data, entry.sent_ns)
        for name, texts in (notes or {}).items():
            writer.add_metadata(name, texts)
        writer.finish()
    return folder


def edited(topic: str, at_ms: int, edit: Callable[..., None]) -> Change:
    """Return a change of the message of one stamp."""

    def change(entries: list[Entry]) -> list[Entry]:
        found = at(entries, topic, at_ms)
        message = found.message()
        edit(message)
        return [found.with_message(message) if entry is found else entry for entry in entries]

    return change


def edited_tick(topic: str, at_ms: int, edit: Callable[..., None]) -> Change:
    """Return a change of one tick of a JointTrajectory, which holds many.

    Args:
        edit: Takes the point of the tick and the names.
    """

    def change(entries: list[Entry]) -> list[Entry]:
        found = [e for e in of(entries, topic) if e.stamp_ns() <= at_ms * MS][-1]
        message = found.message()
        ahead_ns = at_ms * MS - found.stamp_ns()
        (point,) = [p for p in message.points if p.time_from_start.nanosec == ahead_ns]
        edit(point, list(message.joint_names))
        return [found.with_message(message) if entry is found else entry for entry in entries]

    return change


def without(topic: str, *at_ms: int) -> Change:
    """Return a change that leaves out the messages of some stamps, or a whole topic."""

    def change(entries: list[Entry]) -> list[Entry]:
        if not at_ms:
            return [entry for entry in entries if entry.topic != topic]
        lost = {id(at(entries, topic, t)) for t in at_ms}
        return [entry for entry in entries if id(entry) not in lost]

    return change


def again(topic: str, at_ms: int, edit: Callable[..., None] | None = None) -> Change:
    """Return a change that sends a message again a little later, edited or not."""

    def change(entries: list[Entry]) -> list[Entry]:
        found = at(entries, topic, at_ms)
        message = found.message()
        if edit is not None:
            edit(message)
        place = entries.index(found) + 40
        return [*entries[:place], found.with_message(message), *entries[place:]]

    return change


def swapped(topic: str, at_ms: int, other_ms: int) -> Change:
    """Return a change that swaps two messages of a topic in the file."""

    def change(entries: list[Entry]) -> list[Entry]:
        one, other = at(entries, topic, at_ms), at(entries, topic, other_ms)
        places = {id(one): other, id(other): one}
        return [places.get(id(entry), entry) for entry in entries]

    return change


def at(entries: list[Entry], topic: str, at_ms: int) -> Entry:
    """Return the message of a topic with a stamp [ms]."""
    return next(e for e in of(entries, topic) if e.stamp_ns() == at_ms * MS)


def of(entries: list[Entry], topic: str) -> Iterator[Entry]:
    """Yield the messages of a topic."""
    return (entry for entry in entries if entry.topic == topic)


def assign(part, field: str, index: int, value: float) -> None:
    """Change one number of a message's sequence; rosbags hands out sequences to read only."""
    values = getattr(part, field).copy()
    values[index] = value
    setattr(part, field, values)


def set_state(name: str, field: str, value: float) -> Callable[..., None]:
    """Return an edit of one entry of a JointState."""

    def edit(message) -> None:
        assign(message, field, message.name.index(name), value)

    return edit
