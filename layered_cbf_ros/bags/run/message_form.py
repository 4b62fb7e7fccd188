"""The form of a message: where its numbers stand, so that many are read at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.cdr import STAMP_OFFSET, TEXT_OFFSET, CdrReader

POSITION, VELOCITY, EFFORT = range(3)
"""Fields of a JointState, in this order."""


@dataclass(frozen=True, slots=True)
class MessageForm:
    """How messages that differ only in stamp, doubles and padding are to be read.

    Attributes:
        names: Names in the message.
        offsets_ns: Time of each of its points after the header's stamp [ns], (k,).
        places: Point, first field and doubles a name, of each block of doubles.
        blocks: Offset [byte] and count of each block.
        mask: Which bytes are the same in all of them, 255 or 0, (bytes,).
        common: These bytes, zero elsewhere, (bytes,).
    """

    names: tuple[str, ...]
    offsets_ns: NDArray[np.int64]
    places: tuple[tuple[int, int, int], ...]
    blocks: tuple[tuple[int, int], ...]
    mask: NDArray[np.uint8]
    common: NDArray[np.uint8]

    def fits(self, data: bytes) -> bool:
        """Tell whether a message has this form."""
        if len(data) != len(self.mask):
            return False
        return bool((np.frombuffer(data, np.uint8) & self.mask == self.common).all())

    def stamps(self, raw: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return the stamps [ns] of m messages, given as (m, bytes); (m, k)."""
        seconds = raw[:, STAMP_OFFSET : STAMP_OFFSET + 4].view('<i4').astype(np.int64)
        nanoseconds = raw[:, STAMP_OFFSET + 4 : TEXT_OFFSET].view('<u4')
        return seconds * NS_PER_S + nanoseconds + self.offsets_ns

    def read(self, raw: NDArray[np.uint8], values: Array) -> None:
        """Fill in what m messages, given as (m, bytes), hold: values (m, k, f, n)."""
        values[:] = np.nan
        for (point, field, each), (start, count) in zip(self.places, self.blocks, strict=True):
            doubles = raw[:, start : start + 8 * count].view('<f8')
            by_name = doubles.reshape(len(raw), -1, each)
            values[:, point, field : field + each] = by_name.transpose(0, 2, 1)


def form_of(
    data: bytes,
    reader: CdrReader,
    names: tuple[str, ...],
    offsets_ns: list[int],
    places: list[tuple[int, int, int]],
) -> MessageForm:
    """Return the form of a message.

    Args:
        data: The message.
        reader: Has gone through it.
        names, offsets_ns, places: As in MessageForm.
    """
    mask = np.full(len(data), 255, dtype=np.uint8)
    doubles = [(start, start + 8 * count) for start, count in reader.blocks]
    for start, end in ((STAMP_OFFSET, TEXT_OFFSET), *doubles, *reader.padding):
        mask[start:end] = 0
    offsets = np.array(offsets_ns, dtype=np.int64)
    common = np.frombuffer(data, np.uint8) & mask
    return MessageForm(names, offsets, tuple(places), tuple(reader.blocks), mask, common)
