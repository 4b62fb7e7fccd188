"""How a message becomes a row: fields by dotted names, named arrays by their names.

`position` of a JointState becomes a column for each joint; of a trajectory each point
becomes a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.inspection.layout import Layout, Leaf, Path

NAMES = ('name', 'joint_names')
"""Fields whose texts name the entries of the message's arrays."""

POINTS = 'points'
LONGEST = 256
"""An array that is longer, and has no names, is one cell."""


@dataclass(frozen=True, slots=True)
class Column:
    """Where the values of one column stand.

    Attributes:
        leaf: In this value.
        element: Which of its numbers; None for the whole.
    """

    leaf: Leaf
    element: int | None


@dataclass(frozen=True, slots=True)
class Row:
    """A row that a message becomes.

    Attributes:
        point: Number of the point that it is, None for a whole message.
        columns: By label.
    """

    point: int | None
    columns: Mapping[str, Column]


class RowPlan:
    """The rows of all messages that are laid out alike and name the same entries.

    Attributes:
        rows: The rows of each.
        order: As in Layout.
    """

    def __init__(self, layout: Layout, data: bytes) -> None:
        """Take note of a message.

        Args:
            layout: Its layout.
            data: CDR bytes.
        """
        named = [leaf for leaf in layout.leaves if _is_name(leaf)]
        self.order = layout.order
        self.rows = _rows(layout, [_text(leaf, data) for leaf in named])
        self._mask = _mask(layout, named, len(data))
        self._common = np.frombuffer(data, np.uint8) & self._mask

    def fits(self, data: bytes) -> bool:
        """Tell whether a message becomes rows in the same way."""
        if len(data) != len(self._mask):
            return False
        return bool((np.frombuffer(data, np.uint8) & self._mask == self._common).all())


def _rows(layout: Layout, names: list[str]) -> list[Row]:
    """Return the rows of a message whose entries have these names."""
    if len(set(names)) < len(names):
        names = []
    sizes = _sizes(layout)
    shared: dict[str, Column] = {}
    points: dict[int, dict[str, Column]] = {}
    for leaf in layout.leaves:
        if names and _is_name(leaf):
            continue
        point = leaf.path[1] if names and leaf.path[0] == POINTS else None
        into = points.setdefault(point, {}) if isinstance(point, int) else shared
        into.update(_columns(leaf, names, sizes))
    if not points:
        return [Row(None, shared)]
    return [Row(point, shared | columns) for point, columns in sorted(points.items())]


def _columns(leaf: Leaf, names: list[str], sizes: Mapping[Path, int]) -> dict[str, Column]:
    """Return the columns of one value, by label."""
    parts = []
    for k, part in enumerate(leaf.path):
        array = leaf.path[:k]
        if isinstance(part, str):
            parts.append(part)
        elif not (names and array == (POINTS,)):
            parts.append(names[part] if _is_named(array, sizes[array], names) else str(part))
    label = '.'.join(parts)
    if not leaf.is_array:
        return {label: Column(leaf, None)}
    if _is_named(leaf.path, leaf.count, names):
        return {f'{label}.{name}': Column(leaf, k) for k, name in enumerate(names)}
    if leaf.count > LONGEST:
        return {label: Column(leaf, None)}
    return {f'{label}.{k}': Column(leaf, k) for k in range(leaf.count)}


def _is_named(array: Path, size: int, names: list[str]) -> bool:
    """Tell whether the entries of an array are those that the message names."""
    depth = 3 if array[0] == POINTS else 1
    return bool(names) and size == len(names) and len(array) == depth


def _sizes(layout: Layout) -> dict[Path, int]:
    """Return how many entries each array of messages or texts has."""
    sizes: dict[Path, int] = {}
    for leaf in layout.leaves:
        for k, part in enumerate(leaf.path):
            if isinstance(part, int):
                sizes[leaf.path[:k]] = max(sizes.get(leaf.path[:k], 0), part + 1)
    return sizes


def _is_name(leaf: Leaf) -> bool:
    return leaf.kind == 'string' and len(leaf.path) == 2 and leaf.path[0] in NAMES


def _text(leaf: Leaf, data: bytes) -> str:
    return data[leaf.offset : leaf.offset + leaf.count].decode()


def _mask(layout: Layout, named: list[Leaf], size: int) -> NDArray[np.uint8]:
    """Return which bytes must be the same: the byte order, all lengths and the names, (size,)."""
    mask = np.zeros(size, dtype=np.uint8)
    spans = [(0, 2), *((offset, 4) for offset in layout.lengths)]
    spans += [(leaf.offset, leaf.count) for leaf in named]
    for start, count in spans:
        mask[start : start + count] = 255
    return mask
