"""CDR, the wire format of ROS 2: little-endian, each value aligned to its own size.

A message of the 1 kHz path has strings and sequence lengths that never change.
So its bytes are laid out once and only its doubles are written or read per tick;
at 1 kHz a general (de)serialiser would cost ten times as much.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S, Array

ENCAPSULATION = b'\x00\x01\x00\x00'  # CDR, little-endian
STAMP_OFFSET = len(ENCAPSULATION)
TEXT_OFFSET = STAMP_OFFSET + 8


def stamp_of(data: bytes) -> int:
    """Return the header stamp of any message that begins with a std_msgs/Header [ns].

    Raises:
        MessageError: If the message is too short to have one.
    """
    if len(data) < TEXT_OFFSET:
        raise MessageError(f'message of {len(data)} bytes has no header')
    seconds, nanoseconds = struct.unpack_from('<iI', data, STAMP_OFFSET)
    return int(seconds) * NS_PER_S + int(nanoseconds)


class CdrWriter:
    """Lays out one message, field by field."""

    def __init__(self) -> None:
        self.data = bytearray(ENCAPSULATION)
        self.blocks: list[tuple[int, int]] = []

    def align(self, size: int) -> None:
        """Pad with zeros to a multiple of size, counted after the encapsulation."""
        self.data.extend(bytes(-(len(self.data) - len(ENCAPSULATION)) % size))

    def word(self, value: int) -> None:
        """Write a uint32."""
        self.align(4)
        self.data.extend(struct.pack('<I', value))

    def text(self, value: str) -> None:
        """Write a string."""
        encoded = value.encode() + b'\0'
        self.word(len(encoded))
        self.data.extend(encoded)

    def texts(self, values: Sequence[str]) -> None:
        """Write a sequence of strings."""
        self.word(len(values))
        for value in values:
            self.text(value)

    def header(self, frame_id: str) -> None:
        """Write a std_msgs/Header with a zero stamp."""
        self.data.extend(bytes(8))
        self.text(frame_id)

    def doubles(self, length: int, each: int = 1) -> None:
        """Write a sequence of `length` elements of `each` zero doubles, and remember where."""
        self.word(length)
        if length:
            self.align(8)
            self.blocks.append((len(self.data), length * each))
            self.data.extend(bytes(8 * length * each))

    def fixed(self, count: int) -> None:
        """Write a field of so many zero doubles, and remember where."""
        self.align(8)
        self.blocks.append((len(self.data), count))
        self.data.extend(bytes(8 * count))


class CdrReader:
    """Reads one message, field by field, never beyond its end.

    Attributes:
        blocks: Where doubles stand: offset [byte] and count.
        padding: Where bytes stand that mean nothing: first, and the one behind the last.
    """

    def __init__(self, data: bytes) -> None:
        if data[:4] != ENCAPSULATION:
            raise MessageError(f'message of {len(data)} bytes is not little-endian CDR')
        self._data = data
        self._at = len(ENCAPSULATION)
        self.blocks: list[tuple[int, int]] = []
        self.padding: list[tuple[int, int]] = []

    def _advance(self, size: int, alignment: int) -> int:
        start = self._at + -(self._at - len(ENCAPSULATION)) % alignment
        if start + size > len(self._data):
            raise MessageError(f'message of {len(self._data)} bytes ends inside a field')
        if start > self._at:
            self.padding.append((self._at, start))
        self._at = start + size
        return start

    def word(self) -> int:
        """Read a uint32."""
        return int(struct.unpack_from('<I', self._data, self._advance(4, 4))[0])

    def text(self) -> str:
        """Read a string."""
        length = self.word()
        start = self._advance(length, 1)
        return self._data[start : start + length].rstrip(b'\0').decode(errors='replace')

    def texts(self) -> list[str]:
        """Read a sequence of strings."""
        return [self.text() for _ in range(self._length(4))]

    def header(self) -> int:
        """Read a std_msgs/Header; return its stamp [ns]."""
        stamp_ns = stamp_of(self._data)
        self.frame()
        return stamp_ns

    def frame(self) -> str:
        """Read a std_msgs/Header; return its frame_id."""
        self._advance(8, 4)
        return self.text()

    def doubles(self, each: int = 1) -> Array:
        """Read a sequence of elements of `each` doubles, and remember where."""
        length = self._length(8 * each)
        if not length:
            return np.empty(0)
        start = self._advance(8 * each * length, 8)
        self.blocks.append((start, length * each))
        return np.frombuffer(self._data, '<f8', length * each, start).copy()

    def fixed(self, count: int) -> Array:
        """Read a field of so many doubles, and remember where."""
        start = self._advance(8 * count, 8)
        self.blocks.append((start, count))
        return np.frombuffer(self._data, '<f8', count, start).copy()

    def skip(self, count: int) -> None:
        """Pass over a field of so many doubles that mean nothing to the reader."""
        start = self._advance(8 * count, 8)
        self.padding.append((start, self._at))

    def _length(self, size: int) -> int:
        """Read a sequence length; refuse one that can't fit what is left."""
        length = self.word()
        if length * size > len(self._data) - self._at:
            raise MessageError(f'sequence of {length} does not fit {len(self._data)} bytes')
        return length


class FixedLayout:
    """A message whose strings and sequence lengths are known: only doubles change."""

    def __init__(self, data: bytes | bytearray, blocks: Sequence[tuple[int, int]]) -> None:
        self._buffer = bytearray(data)
        self.blocks = tuple(blocks)
        self._views = [
            np.frombuffer(self._buffer, '<f8', count, offset) for offset, count in blocks
        ]
        starts = [TEXT_OFFSET, *(offset + 8 * count for offset, count in blocks)]
        ends = [*(offset for offset, _ in blocks), len(data)]
        self._texts = [
            (start, end, bytes(data[start:end])) for start, end in zip(starts, ends, strict=True)
        ]

    def encode(self, stamp_ns: int, *arrays: Array) -> bytes:
        """Return the message with this stamp and these doubles, one array a block."""
        struct.pack_into('<iI', self._buffer, STAMP_OFFSET, *divmod(stamp_ns, NS_PER_S))
        for view, array in zip(self._views, arrays, strict=True):
            view[:] = array
        return bytes(self._buffer)

    def fits(self, data: bytes) -> bool:
        """Tell whether a message has this very layout, whatever its stamp and doubles."""
        return len(data) == len(self._buffer) and all(
            data[start:end] == text for start, end, text in self._texts
        )

    def arrays(self, data: bytes) -> list[Array]:
        """Return the doubles of a message that fits, as read-only views, one a block."""
        return [np.frombuffer(data, '<f8', count, offset) for offset, count in self.blocks]


def require_finite(values: Array, what: str) -> None:
    """Raise MessageError if any value is NaN or infinite."""
    if not math.isfinite(float(values.sum())):
        raise MessageError(f'{what} has a value that is not finite')
