"""Tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines with aligned columns."""
    widths = _widths(rows)
    return ['  '.join(map(str.ljust, row, widths)).rstrip() for row in rows]


def underlined(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines with aligned columns, the first one underlined."""
    heading, *lines = aligned(rows)
    return [heading, '  '.join('-' * width for width in _widths(rows)).rstrip(), *lines]


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
