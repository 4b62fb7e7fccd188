"""The values of many messages that are laid out alike, column by column."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.inspection.columns import Column, Row, RowPlan

DTYPES = {
    'bool': '?', 'byte': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1', 'int16': 'i2',
    'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4', 'float32': 'f4', 'int64': 'i8',
    'uint64': 'u8', 'float64': 'f8',
}  # fmt: skip
"""What numpy calls each kind of number."""

Cells = NDArray[Any] | list[Any]
"""The cells of a column: an array of numbers, a list of texts, or a list of arrays."""


class Messages:
    """Some messages of one topic that become rows in the same way."""

    def __init__(self, plan: RowPlan) -> None:
        self.plan = plan
        self.size = 0
        self._data: list[bytes] = []
        self._times: list[tuple[int, int]] = []

    def add(self, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Take a message that fits the plan."""
        self._data.append(data)
        self._times.append((log_time_ns, publish_time_ns))
        self.size += len(data)

    def tables(self) -> list[dict[str, Cells]]:
        """Return the cells by label: one table, or one for each kind of point there is."""
        raw = np.frombuffer(b''.join(self._data), np.uint8).reshape(len(self._data), -1)
        times = np.array(self._times, dtype=np.uint64)
        groups: dict[tuple[str, ...], list[Row]] = {}
        for row in self.plan.rows:
            groups.setdefault(tuple(row.columns), []).append(row)
        return [self._table(raw, times, rows) for rows in groups.values()]

    def _table(
        self, raw: NDArray[np.uint8], times: NDArray[np.uint64], rows: list[Row]
    ) -> dict[str, Cells]:
        """Return the cells of rows that have the same labels, message by message."""
        count = len(rows)
        table: dict[str, Cells] = {
            'log_time_ns': np.repeat(times[:, 0], count),
            'publish_time_ns': np.repeat(times[:, 1], count),
        }
        if rows[0].point is not None:
            table['point'] = np.tile([row.point for row in rows], len(raw))
        for label in rows[0].columns:
            parts = [self._cells(raw, row.columns[label]) for row in rows]
            table[label] = parts[0] if count == 1 else _interleaved(parts)
        return table

    def _cells(self, raw: NDArray[np.uint8], column: Column) -> Cells:
        leaf, element = column.leaf, column.element
        if leaf.kind == 'string':
            texts = raw[:, leaf.offset : leaf.offset + leaf.count]
            return [bytes(text).decode(errors='backslashreplace') for text in texts]
        dtype = np.dtype(self.plan.order + DTYPES[leaf.kind])
        start, count = leaf.offset + dtype.itemsize * (element or 0), leaf.count
        if element is not None or not leaf.is_array:
            count = 1
        numbers = raw[:, start : start + dtype.itemsize * count]
        values = np.ascontiguousarray(numbers).view(dtype).astype(dtype.newbyteorder('='))
        return list(values) if leaf.is_array and element is None else values[:, 0]


def _interleaved(parts: list[Cells]) -> Cells:
    """Return the first cells of all parts, then the second ones, and so on."""
    if isinstance(parts[0], np.ndarray):
        return np.stack(parts, axis=1).ravel()
    return [cell for cells in zip(*parts, strict=True) for cell in cells]
