"""Numbers over time out of three message types, decoded fast enough for a minute at 1 kHz."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.message_form import MessageForm, form_of
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.cdr import CdrReader

TRANSFORM, TWIST = 7, 6  # doubles in a geometry_msgs/Transform and /Twist
TOGETHER = 1 << 20
"""Messages of one form are read together once they have so many bytes."""


@dataclass(frozen=True, slots=True)
class Series:
    """Named quantities over time.

    Attributes:
        names: Their names, (n,).
        stamps_ns: Stamps, strictly increasing [ns], (k,).
        values: (k, f, n) for f fields; NaN where a message lacked a name.
        contradictions: Messages that repeat a stamp with other values.
    """

    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    values: Array
    contradictions: int = 0

    @property
    def times(self) -> Array:
        """Stamps [s], (k,)."""
        return self.stamps_ns / NS_PER_S

    def columns(self, names: list[str]) -> NDArray[np.intp]:
        """Return where names stand.

        Raises:
            BagError: Naming the first that is absent.
        """
        place = {name: i for i, name in enumerate(self.names)}
        for name in names:
            if name not in place:
                raise BagError(f"no entry '{name}' among {', '.join(self.names[:4])}, ...")
        return np.array([place[name] for name in names], dtype=np.intp)


class _Segment:
    """Rows of the same names; they grow in place, so that none is ever held twice for long."""

    def __init__(self, names: tuple[str, ...], fields: int) -> None:
        self.names = names
        self.count = 0
        self._stamps = np.empty(0, dtype=np.int64)
        self._values = np.empty((0, fields, len(names)))

    @property
    def stamps(self) -> NDArray[np.int64]:
        return self._stamps[: self.count]

    @property
    def values(self) -> Array:
        return self._values[: self.count]

    def append(self, stamps: NDArray[np.int64]) -> Array:
        """Append rows with these stamps; return their values, to be filled in."""
        before, self.count = self.count, self.count + len(stamps)
        if self.count > len(self._stamps):
            self._stamps = _longer(self._stamps, before, self.count)
            self._values = _longer(self._values, before, self.count)
        self._stamps[before : self.count] = stamps
        return self._values[before : self.count]


class SeriesBuilder:
    """Gathers the messages of one topic into a Series; subclasses know one type.

    A message in the form of the one before it costs only a comparison; a megabyte of
    them is then read together.
    """

    fields: int

    def __init__(self) -> None:
        self._form: MessageForm | None = None
        self._waiting: list[bytes] = []
        self._segments: list[_Segment] = []

    def add(self, data: bytes) -> None:
        """Take one message, CDR bytes.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        self._form_of(data)
        self._waiting.append(data)
        if len(self._waiting) * len(data) > TOGETHER:
            self._take_waiting()

    def read(self, data: bytes) -> tuple[tuple[str, ...], list[int], Array]:
        """Return what one message holds, without keeping it.

        Returns:
            Names (n,), stamps (k,) [ns] and values (k, f, n), as in Series.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        form, raw = self._form_of(data), np.frombuffer(data, np.uint8)[None]
        values = np.empty((1, len(form.offsets_ns), self.fields, len(form.names)))
        form.read(raw, values)
        return form.names, form.stamps(raw)[0].tolist(), values[0]

    def build(self) -> Series | None:
        """Return all that was taken, in stamp order; None if it was nothing.

        Of several messages with one stamp the first counts: senders repeat a
        message that they believe lost.
        """
        self._take_waiting()
        segments = [segment for segment in self._segments if segment.count]
        if not segments:
            return None
        if len(segments) == 1:
            return _ordered(segments[0].names, segments[0].stamps, segments[0].values)
        names = tuple(dict.fromkeys(name for segment in segments for name in segment.names))
        stamps = np.concatenate([segment.stamps for segment in segments])
        values = np.full((len(stamps), self.fields, len(names)), np.nan)
        row = 0
        for segment in segments:
            columns = [names.index(name) for name in segment.names]
            values[row : row + segment.count][:, :, columns] = segment.values
            row += segment.count
        return _ordered(names, stamps, values)

    def _form_of(self, data: bytes) -> MessageForm:
        """Return the form of a message, which the next one probably has too."""
        form = self._form
        if form is None or not form.fits(data):
            learned = self._learn(data)
            self._take_waiting()
            form = self._form = learned
        return form

    def _take_waiting(self) -> None:
        """Read the messages that wait; all have the present form."""
        form, waiting = self._form, self._waiting
        if form is None or not waiting:
            return
        raw = np.frombuffer(b''.join(waiting), np.uint8).reshape(len(waiting), -1)
        if not self._segments or self._segments[-1].names != form.names:
            self._segments.append(_Segment(form.names, self.fields))
        values = self._segments[-1].append(form.stamps(raw).ravel())
        shape = len(waiting), len(form.offsets_ns), self.fields, len(form.names)
        form.read(raw, values.reshape(shape))
        waiting.clear()

    def _learn(self, data: bytes) -> MessageForm:
        """Read a message field by field."""
        raise NotImplementedError


class JointStates(SeriesBuilder):
    """sensor_msgs/JointState; fields are position, velocity, effort, NaN if left empty."""

    fields = 3

    def _learn(self, data: bytes) -> MessageForm:
        reader = CdrReader(data)
        reader.header()
        names = tuple(reader.texts())
        places = [(0, f, 1) for f in range(self.fields) if _read_block(reader, names)]
        return form_of(data, reader, names, [0], places)


class JointTrajectories(SeriesBuilder):
    """trajectory_msgs/JointTrajectory, a point a tick.

    Fields are position, velocity, acceleration, effort, NaN if left empty; a point
    stands for the header's stamp + time_from_start.
    """

    fields = 4

    def _learn(self, data: bytes) -> MessageForm:
        reader = CdrReader(data)
        reader.header()
        names = tuple(reader.texts())
        places, offsets = [], []
        for point in range(reader.word()):
            places += [(point, f, 1) for f in range(self.fields) if _read_block(reader, names)]
            offsets.append(reader.word() * NS_PER_S + reader.word())
        return form_of(data, reader, names, offsets, places)


class PlannedMotions(SeriesBuilder):
    """trajectory_msgs/MultiDOFJointTrajectory, of which the first point counts.

    Fields are the transform (x y z qx qy qz qw), velocity (x y z, then angular)
    and acceleration (the same): 19 in all.
    """

    fields = TRANSFORM + 2 * TWIST

    def _learn(self, data: bytes) -> MessageForm:
        reader = CdrReader(data)
        reader.header()
        names = tuple(reader.texts())
        if not reader.word():
            raise BagError('planned motion has no point')
        places, field = [], 0
        for each in (TRANSFORM, TWIST, TWIST):
            if _read_block(reader, names, each):
                places.append((0, field, each))
            field += each
        return form_of(data, reader, names, [0], places)


def _longer(rows: NDArray[Any], count: int, needed: int) -> NDArray[Any]:
    """Return an array with the first `count` rows, and room that costs nothing while unused."""
    longer = np.empty((max(needed, 2 * len(rows)), *rows.shape[1:]), rows.dtype)
    longer[:count] = rows[:count]
    return longer


def _read_block(reader: CdrReader, names: tuple[str, ...], each: int = 1) -> bool:
    """Pass over `each` doubles a name; tell whether they are there."""
    length = len(reader.doubles(each))
    if length not in (0, each * len(names)):
        raise BagError(f'message with {len(names)} names has {length // each} values')
    return length > 0


def _ordered(names: tuple[str, ...], stamps: NDArray[np.int64], values: Array) -> Series:
    """Sort by stamp and drop repetitions, counting those that contradict the first."""
    if bool(np.all(np.diff(stamps) > 0)):
        return Series(names, stamps, values)
    kept, first, which = np.unique(stamps, return_index=True, return_inverse=True)
    repeated = np.setdiff1d(np.arange(len(stamps)), first)
    contradictions = sum(
        not np.array_equal(values[i], values[first[which[i]]], equal_nan=True) for i in repeated
    )
    return Series(names, kept, values[first], contradictions)
