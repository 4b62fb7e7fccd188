"""Where every value of a message stands in its bytes.

Most messages of a topic are laid out like the one before: what was found for one tells,
by a comparison of a few numbers, that the next one fits its type, and where its values are.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.messages.cdr import ENCAPSULATION

SIZES = {
    'bool': 1, 'byte': 1, 'char': 1, 'int8': 1, 'uint8': 1, 'int16': 2, 'uint16': 2,
    'int32': 4, 'uint32': 4, 'float32': 4, 'int64': 8, 'uint64': 8, 'float64': 8,
}  # fmt: skip
"""Bytes of each kind of number."""

ORDERS = {b'\0\0': '>', b'\0\1': '<'}
TIME = 'builtin_interfaces/msg/Time'
SPARE = 3
"""Bytes that may follow the last field."""

Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Leaf:
    """A number, a text, or an array of numbers.

    Attributes:
        path: Names of the fields and places in the arrays that lead to it.
        kind: Its type: a key of SIZES, or 'string'.
        offset: Its first byte.
        count: How many numbers; of a text, how many bytes.
        is_array: Whether it is an array, even if of one.
    """

    path: Path
    kind: str
    offset: int
    count: int
    is_array: bool


class Layout:
    """Where the values of a message stand, and of all that are laid out alike.

    Attributes:
        leaves: Its values, in order.
        lengths: Where the lengths of its texts and sequences stand [byte].
        order: '<' for little-endian numbers, '>' for others.
    """

    def __init__(self, data: bytes, leaves: tuple[Leaf, ...], lengths: list[int]) -> None:
        """Take note of a message.

        Args:
            data: CDR bytes.
            leaves, lengths: As above.
        """
        self.leaves = leaves
        self.lengths = lengths
        self.order = ORDERS[data[:2]]
        self._size = len(data)
        pattern, at = f'{self.order}2s', 2
        for offset in lengths:
            pattern += f'{offset - at}xI'
            at = offset + 4
        self._unpack_lengths = struct.Struct(pattern).unpack_from
        self._expected = self._unpack_lengths(data)

    def fits(self, data: bytes) -> bool:
        """Tell whether a message is laid out like this."""
        return len(data) == self._size and self._unpack_lengths(data) == self._expected


def lay_out(store: Typestore, type_name: str, data: bytes) -> Layout:
    """Return the layout of a message.

    Args:
        store: Knows the type.
        type_name: `package/msg/Type`.
        data: CDR bytes.

    Raises:
        BagError: If the bytes are no such message; says why.
    """
    if data[:2] not in ORDERS:
        raise BagError(f'begins with {data[:4].hex() or "nothing"}, which is no CDR')
    walk = _Walk(store, data)
    leaves = tuple(walk.fields(type_name, ()))
    if walk.at + SPARE < len(data):
        raise BagError(f'has {len(data) - walk.at} bytes behind its last field')
    return Layout(data, leaves, walk.lengths)


def begins_with_stamp(store: Typestore, type_name: str) -> bool:
    """Tell whether messages of a type begin with a stamp, in a header or without one."""
    while type_name != TIME:
        fields = store.fielddefs[type_name][1]
        if not fields or fields[0][1][0] != Nodetype.NAME:
            return False
        type_name = str(fields[0][1][1])
    return True


class _Walk:
    """Goes through a message, field by field, never beyond its end."""

    def __init__(self, store: Typestore, data: bytes) -> None:
        self.at = len(ENCAPSULATION)
        self.lengths: list[int] = []
        self._store = store
        self._data = data
        self._word = struct.Struct(ORDERS[data[:2]] + 'I').unpack_from

    def fields(self, type_name: str, path: Path) -> Iterator[Leaf]:
        """Yield the leaves of a message or of a part of it."""
        for name, (node, inner) in self._store.fielddefs[type_name][1]:
            here = (*path, name)
            if node == Nodetype.BASE:
                yield self._single(str(inner[0]), here)
            elif node == Nodetype.NAME:
                yield from self.fields(str(inner), here)
            elif node == Nodetype.ARRAY:
                yield from self._elements(inner[0], int(inner[1]), here)
            else:
                yield from self._elements(inner[0], self._length(), here)

    def _elements(self, kind: Any, count: int, path: Path) -> Iterator[Leaf]:
        """Yield the leaves of an array or sequence of so many elements."""
        node, inner = kind
        if node == Nodetype.NAME:
            for k in range(count):
                yield from self.fields(str(inner), (*path, k))
        elif inner[0] == 'string':
            for k in range(count):
                yield self._single('string', (*path, k))
        else:
            yield Leaf(path, inner[0], self._numbers(inner[0], count), count, True)

    def _single(self, kind: str, path: Path) -> Leaf:
        if kind != 'string':
            return Leaf(path, kind, self._numbers(kind, 1), 1, False)
        length = self._length()
        start = self._advance(length, 1)
        if not length or self._data[self.at - 1]:
            raise BagError('has a text without an end')
        try:
            self._data[start : self.at - 1].decode()
        except UnicodeDecodeError:
            raise BagError('has a text that is no UTF-8') from None
        return Leaf(path, 'string', start, length - 1, False)

    def _length(self) -> int:
        start = self._advance(4, 4)
        self.lengths.append(start)
        return int(self._word(self._data, start)[0])

    def _numbers(self, kind: str, count: int) -> int:
        """Pass over numbers; return where they begin."""
        size = SIZES.get(kind)
        if size is None:
            raise BagError(f"has a field of type '{kind}', which can't be read")
        return self._advance(size * count, size) if count else self.at

    def _advance(self, size: int, alignment: int) -> int:
        start = self.at + -(self.at - len(ENCAPSULATION)) % alignment
        if start + size > len(self._data):
            raise BagError('ends inside a field')
        self.at = start + size
        return start
