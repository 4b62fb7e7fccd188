"""Numbers over time out of three message types, decoded fast enough for a minute at 1 kHz."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.cdr import CdrReader, FixedLayout, stamp_of

TRANSFORM, TWIST = 7, 6  # doubles in a geometry_msgs/Transform and /Twist


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


@dataclass(frozen=True, slots=True)
class _Form:
    """How messages that differ only in stamp and doubles are to be read.

    Attributes:
        names: Names in the message.
        offsets_ns: Time of each of its points after the header's stamp [ns].
        places: Point, first field and doubles a name, of each block of doubles.
        layout: Where the blocks are.
    """

    names: tuple[str, ...]
    offsets_ns: tuple[int, ...]
    places: tuple[tuple[int, int, int], ...]
    layout: FixedLayout


class SeriesBuilder:
    """Gathers the messages of one topic into a Series; subclasses know one type.

    A message laid out like the one before it costs only a comparison and a copy.
    """

    fields: int

    def __init__(self) -> None:
        self._form: _Form | None = None
        self._segments: list[tuple[tuple[str, ...], list[int], list[Array]]] = []

    def add(self, data: bytes) -> None:
        """Take one message, CDR bytes.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        form = self._form
        if form is None or not form.layout.fits(data):
            form = self._form = self._learn(data)
        values = np.full((len(form.offsets_ns), self.fields, len(form.names)), np.nan)
        arrays = form.layout.arrays(data)
        for (point, field, each), array in zip(form.places, arrays, strict=True):
            values[point, field : field + each] = array.reshape(-1, each).T
        if not self._segments or self._segments[-1][0] != form.names:
            self._segments.append((form.names, [], []))
        _, stamps, parts = self._segments[-1]
        start_ns = stamp_of(data)
        stamps.extend(start_ns + offset for offset in form.offsets_ns)
        parts.append(values)

    def build(self) -> Series | None:
        """Return all that was taken, in stamp order; None if it was nothing.

        Of several messages with one stamp the first counts: senders repeat a
        message that they believe lost.
        """
        stamps = np.array([s for _, part, _ in self._segments for s in part], dtype=np.int64)
        if not len(stamps):
            return None
        names = tuple(dict.fromkeys(name for names, _, _ in self._segments for name in names))
        values = np.full((len(stamps), self.fields, len(names)), np.nan)
        row = 0
        for part_names, part, arrays in self._segments:
            columns = [names.index(name) for name in part_names]
            values[row : row + len(part), :, columns] = np.concatenate(arrays)
            row += len(part)
        return _ordered(names, stamps, values)

    def _learn(self, data: bytes) -> _Form:
        """Read a message field by field."""
        raise NotImplementedError


class JointStates(SeriesBuilder):
    """sensor_msgs/JointState; fields are position, velocity, effort, NaN if left empty."""

    fields = 3

    def _learn(self, data: bytes) -> _Form:
        reader = CdrReader(data)
        reader.header()
        names = tuple(reader.texts())
        places = [(0, f, 1) for f in range(self.fields) if _read_block(reader, names)]
        return _Form(names, (0,), tuple(places), FixedLayout(data, reader.blocks))


class JointTrajectories(SeriesBuilder):
    """trajectory_msgs/JointTrajectory, a point a tick.

    Fields are position, velocity, acceleration, effort, NaN if left empty; a point
    stands for the header's stamp + time_from_start.
    """

    fields = 4

    def _learn(self, data: bytes) -> _Form:
        reader = CdrReader(data)
        reader.header()
        names = tuple(reader.texts())
        places, offsets = [], []
        for point in range(reader.word()):
            places += [(point, f, 1) for f in range(self.fields) if _read_block(reader, names)]
            offsets.append(reader.word() * NS_PER_S + reader.word())
        return _Form(names, tuple(offsets), tuple(places), FixedLayout(data, reader.blocks))


class PlannedMotions(SeriesBuilder):
    """trajectory_msgs/MultiDOFJointTrajectory, of which the first point counts.

    Fields are the transform (x y z qx qy qz qw), velocity (x y z, then angular)
    and acceleration (the same): 19 in all.
    """

    fields = TRANSFORM + 2 * TWIST

    def _learn(self, data: bytes) -> _Form:
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
        return _Form(names, (0,), tuple(places), FixedLayout(data, reader.blocks))


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
