"""Tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines with aligned columns, two spaces in."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ['  ' + '  '.join(map(str.ljust, row, widths)).rstrip() for row in rows]
