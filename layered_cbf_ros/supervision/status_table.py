"""What nodes tell of themselves, as a table for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from layered_cbf_ros.health import Level, Report

HEADINGS = (
    'node', 'level', 'state', 'rate', 'missed', 'jitter', 'p50', 'p99', 'max', 'refused', 'CPU',
    'what is wrong',
)  # fmt: skip
LEFT = ('node', 'level', 'state', 'what is wrong')
GAP = '  '
COLOURS = {Level.OK: 32, Level.WARN: 33, Level.ERROR: 31, Level.STALE: 35}
US_PER_MS = 1e3


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Attributes:
        level: How well the node is.
        cells: A text for each heading.
    """

    level: Level
    cells: tuple[str, ...]


def row_of(report: Report, processor: float | None = None) -> Row:
    """Return the line of a node, of ours or of others.

    Args:
        report: What is known of it.
        processor: Share of one processor core that it uses, None if unknown.
    """
    values = report.values
    cells = (
        report.name,
        report.level.name,
        values.get('state', ''),
        _number(values, 'rate_hz', ' Hz'),
        values.get('deadline_misses', ''),
        _milliseconds(values, 'jitter_p99_us'),
        _milliseconds(values, 'solve_time_p50_us'),
        _milliseconds(values, 'solve_time_p99_us'),
        _milliseconds(values, 'solve_time_max_us'),
        values.get('rejected', ''),
        '' if processor is None else f'{100.0 * processor:.0f} %',
        _wrong(report),
    )
    return Row(report.level, cells)


def table_lines(
    rows: Sequence[Row], columns: int | None = None, coloured: bool = False
) -> list[str]:
    """Return the table as aligned text; times are in milliseconds.

    Args:
        rows: Its lines.
        columns: Width of the terminal: what does not fit is cut, what is wrong goes below.
        coloured: Whether levels are painted.
    """
    shown = [k for k, name in enumerate(HEADINGS) if name != 'CPU' or any(r.cells[k] for r in rows)]
    table = [HEADINGS, *(row.cells for row in rows)]
    widths = {k: max(len(cells[k]) for cells in table) for k in shown}
    lines = _wrapped(_aligned(HEADINGS, widths), HEADINGS[-1], columns)[:1]
    for row in rows:
        first, *rest = _wrapped(_aligned(row.cells, widths), row.cells[-1], columns)
        if coloured:
            begin = widths[0] + len(GAP)
            first = _painted(first, begin, begin + len(row.level.name), COLOURS[row.level])
        lines += [first, *rest]
    return lines


def _aligned(cells: Sequence[str], widths: Mapping[int, int]) -> str:
    """Return all cells but the last, each at its place."""
    return GAP.join(
        cells[k].ljust(width) if HEADINGS[k] in LEFT else cells[k].rjust(width)
        for k, width in widths.items()
        if k < len(cells) - 1
    )


def _wrapped(line: str, words: str, columns: int | None) -> list[str]:
    """Return a line with the last cell behind it, or below it if the terminal is too narrow."""
    whole = f'{line}{GAP}{words}'.rstrip()
    if columns is None or len(whole) < columns:
        return [whole]
    below = [f'    {words}'[: columns - 1]] if words else []
    return [line[: columns - 1].rstrip(), *below]


def _painted(line: str, begin: int, end: int, colour: int) -> str:
    """Return a line of which a part, as far as it is there, has a colour."""
    return f'{line[:begin]}\x1b[{colour}m{line[begin:end]}\x1b[0m{line[end:]}'


def _wrong(report: Report) -> str:
    """Return in words what is wrong, or what a node that starts waits for."""
    values = report.values
    if values.get('state') == 'starting' and values.get('waiting_for'):
        return f'waits for {values["waiting_for"]}'
    return values.get('faults') or ('' if report.level is Level.OK else report.message)


def _number(values: Mapping[str, str], key: str, unit: str = '') -> str:
    try:
        return f'{float(values[key]):.0f}{unit}'
    except (KeyError, ValueError):
        return ''


def _milliseconds(values: Mapping[str, str], key: str) -> str:
    try:
        return f'{float(values[key]) / US_PER_MS:.2f}'
    except (KeyError, ValueError):
        return ''
