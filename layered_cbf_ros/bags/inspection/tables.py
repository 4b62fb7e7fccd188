"""Files of rows: CSV for everybody, parquet where pyarrow is installed."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from layered_cbf_ros.bags.inspection.cells import Cells
from layered_cbf_ros.errors import BagError

TOGETHER = 1 << 21
"""Rows of a parquet file are written together once they have so many bytes."""


class Table(Protocol):
    """A file that takes rows with the same labels."""

    def write(self, columns: Mapping[str, Cells]) -> None:
        """Append rows, given by columns."""

    def close(self) -> None:
        """End the file."""


class CsvTable:
    """A CSV file: a line of labels, then a line a row; numbers keep every digit they need."""

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: If it can't be written.
        """
        self._file = path.open('w', encoding='utf-8', newline='')
        self._writer = csv.writer(self._file, lineterminator='\n')
        self._is_empty = True

    def write(self, columns: Mapping[str, Cells]) -> None:
        """Append rows, given by columns."""
        if self._is_empty:
            self._writer.writerow(columns)
            self._is_empty = False
        self._writer.writerows(zip(*map(_written, columns.values()), strict=True))

    def close(self) -> None:
        """End the file."""
        self._file.close()


class ParquetTable:
    """A parquet file; its columns have the types of the message's fields."""

    def __init__(self, path: Path) -> None:
        """Take note of the file; it is created with the first rows.

        Raises:
            BagError: If pyarrow isn't installed.
        """
        self._path = path
        self._arrow = require_pyarrow()
        self._writer: Any = None
        self._waiting: list[Any] = []
        self._size = 0

    def write(self, columns: Mapping[str, Cells]) -> None:
        """Append rows, given by columns; a few rows wait until there are more."""
        table = self._arrow.table({label: self._array(cells) for label, cells in columns.items()})
        self._waiting.append(table)
        self._size += table.nbytes
        if self._size > TOGETHER:
            self._write_waiting()

    def close(self) -> None:
        """End the file."""
        if self._waiting:
            self._write_waiting()
        if self._writer is not None:
            self._writer.close()

    def _write_waiting(self) -> None:
        arrow, table = self._arrow, self._arrow.concat_tables(self._waiting)
        self._waiting, self._size = [], 0
        if self._writer is None:
            texts = [field.name for field in table.schema if field.type == arrow.string()]
            self._writer = arrow.parquet.ParquetWriter(
                self._path, table.schema, use_dictionary=texts
            )
        self._writer.write_table(table)

    def _array(self, cells: Cells) -> Any:
        arrow = self._arrow
        if isinstance(cells, np.ndarray):
            return arrow.array(cells)
        if isinstance(cells[0], str):
            return arrow.array(cells, arrow.string())
        return arrow.array(cells, arrow.list_(arrow.from_numpy_dtype(cells[0].dtype)))


FORMATS: Mapping[str, type[CsvTable] | type[ParquetTable]] = {
    'csv': CsvTable,
    'parquet': ParquetTable,
}


def require_pyarrow() -> Any:
    """Return pyarrow, which only parquet needs.

    Raises:
        BagError: If it isn't installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise BagError(
            '--export parquet needs pyarrow; `pip install pyarrow`, or take csv'
        ) from None
    return pyarrow


def _written(cells: Cells) -> list[Any]:
    """Return cells as the csv module writes them: an array in a cell as JSON."""
    if isinstance(cells, np.ndarray):
        plain: list[Any] = cells.tolist()
        return plain
    return [cell if isinstance(cell, str) else json.dumps(cell.tolist()) for cell in cells]
