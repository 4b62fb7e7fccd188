"""All that a bag holds of one topic: its numbers by stamp, and when each message came."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.messages.cdr import stamp_of

BLOCK = 4096
"""Messages decoded together: large lists of small arrays would double the memory."""


_Late = tuple[Series, tuple[int, int, int], int]
"""A message that isn't the newest: numbers, its stamp, sending and recording time [ns], and
how far its stamp is behind the newest [ns]."""


class SeriesSource(Protocol):
    """Turns messages of one type into a Series, see bags.run.series.SeriesBuilder."""

    def add(self, data: bytes) -> None:
        """Take one message."""
        ...

    def build(self) -> Series | None:
        """Return all that was taken."""
        ...


@dataclass(frozen=True, slots=True)
class Trace:
    """One topic, or one track of a topic.

    Attributes:
        topic: Its name.
        series: Numbers by stamp, each stamp once: the first message of it counts.
        stamps_ns, sent_ns, logged_ns: Of each message that was new, in the order of the
            bag: header stamp, and wall times of sending and recording [ns], (k,).
        repeated: Messages that were sent again, equal to the first.
        contradictions: Stamps of messages that say otherwise than the first of them [ns].
        disorder: Stamps of new messages that came after a later stamp, and how far they
            were behind it [ns].
    """

    topic: str
    series: Series
    stamps_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    logged_ns: NDArray[np.int64]
    repeated: int
    contradictions: tuple[int, ...]
    disorder: tuple[tuple[int, int], ...]


@dataclass
class TraceBuilder:
    """Gathers one topic while the bag streams by.

    Attributes:
        topic: Its name.
        source: Makes a decoder of its type.
    """

    topic: str
    source: Callable[[], SeriesSource]
    _newest_ns: int = -1
    _times: list[tuple[int, int, int]] = field(default_factory=list)
    _blocks: list[Series] = field(default_factory=list)
    _block_times: list[NDArray[np.int64]] = field(default_factory=list)
    _late: list[_Late] = field(default_factory=list)
    _decoder: SeriesSource | None = None

    def take(self, record: Record) -> None:
        """Take one message.

        Raises:
            BagError, MessageError: If it can't be decoded.
        """
        stamp_ns = stamp_of(record.data)
        times = stamp_ns, record.publish_time_ns, record.log_time_ns
        if stamp_ns <= self._newest_ns:
            alone = self.source()
            alone.add(record.data)
            series = alone.build()
            if series is not None:
                self._late.append((series, times, self._newest_ns - stamp_ns))
            return
        if self._decoder is None:
            self._decoder = self.source()
        self._decoder.add(record.data)
        self._newest_ns = stamp_ns
        self._times.append(times)
        if len(self._times) == BLOCK:
            self._end_block()

    def build(self) -> Trace | None:
        """Return what was gathered, None if there was nothing."""
        self._end_block()
        if not self._blocks:
            return None
        blocks, self._blocks = self._blocks, []
        series = joined(blocks)
        del blocks
        new, old = self._sorted_late(series)
        if new:
            series = joined([series, *(late for late, _, _ in new)])
        self._times += [times for _, times, _ in new]
        wrong = [times[0] for late, times, _ in old if not agree(series, late)]
        self._end_block()
        times = np.concatenate(self._block_times).T
        stamps_ns, sent_ns, logged_ns = times
        return Trace(
            self.topic,
            series,
            stamps_ns,
            sent_ns,
            logged_ns,
            len(old) - len(wrong),
            tuple(wrong),
            tuple((times[0], behind) for _, times, behind in new),
        )

    def _sorted_late(self, series: Series) -> tuple[list[_Late], list[_Late]]:
        """Return the late messages with a stamp that nobody had, and the others."""
        new: dict[int, _Late] = {}
        old = []
        for late, times, behind in self._late:
            if times[0] in new or np.isin(late.stamps_ns, series.stamps_ns).any():
                old.append((late, times, behind))
            else:
                new[times[0]] = late, times, behind
        return list(new.values()), old

    def _end_block(self) -> None:
        if self._decoder is not None:
            series = self._decoder.build()
            if series is not None:
                self._blocks.append(series)
        self._block_times.append(np.array(self._times, dtype=np.int64).reshape(-1, 3))
        self._decoder, self._times = None, []


def joined(parts: Sequence[Series]) -> Series:
    """Return several series as one, in stamp order; NaN where a part lacks a name."""
    names = tuple(dict.fromkeys(name for part in parts for name in part.names))
    if len(parts) == 1:
        return parts[0]
    stamps = np.concatenate([part.stamps_ns for part in parts])
    values = np.full((len(stamps), parts[0].values.shape[1], len(names)), np.nan)
    row = 0
    for part in parts:
        columns = [names.index(name) for name in part.names]
        target = values[row : row + len(part.stamps_ns)]
        if part.names == names:
            target[:] = part.values
        else:
            target[:, :, columns] = part.values
        row += len(part.stamps_ns)
    if not bool(np.all(np.diff(stamps) > 0)):
        stamps, order = np.unique(stamps, return_index=True)
        values = values[order]
    return Series(names, stamps, values)


def agree(series: Series, late: Series) -> bool:
    """Tell whether a message sent again says what the first of its stamp said."""
    if late.contradictions or not set(late.names) <= set(series.names):
        return False
    rows = np.searchsorted(series.stamps_ns, late.stamps_ns)
    if rows[-1] >= len(series.stamps_ns) or (series.stamps_ns[rows] != late.stamps_ns).any():
        return False
    columns = series.columns(list(late.names))
    first = series.values[rows][:, :, columns]
    return bool(np.array_equal(first, late.values, equal_nan=True))
