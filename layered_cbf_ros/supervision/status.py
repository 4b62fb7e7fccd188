"""The state of every process of a run, as rows of a table."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.supervision.child import describe_exit

STALE_AFTER = 3.0
"""A running node whose diagnostics are older is not trusted any more [s]."""


@dataclass(frozen=True, slots=True)
class Report:
    """The last diagnostics of a node.

    Attributes:
        values: Its key-values.
        heard_at: Wall time when they came [s].
    """

    values: Mapping[str, str]
    heard_at: float


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Attributes:
        name: Full name of the node.
        state: One word, or how it ended.
        rate: Ticks per wall second [Hz], None if unknown.
        processor: Share of one processor core it uses, None if unknown.
        note: What a person should know, '' if nothing.
    """

    name: str
    state: str
    rate: float | None
    processor: float | None
    note: str


def silent_nodes(names: Sequence[str], reports: Mapping[str, Report], now: float) -> list[str]:
    """Return the nodes whose diagnostics have stopped."""
    return [
        name for name in names if name in reports and now - reports[name].heard_at > STALE_AFTER
    ]


def status_rows(
    names: Sequence[str],
    ended: Mapping[str, int],
    ready: frozenset[str],
    reports: Mapping[str, Report],
    processor: Mapping[str, float],
    now: float,
) -> list[Row]:
    """Fold all that is known into one row for each node.

    Args:
        names: All nodes of the run.
        ended: Exit codes of those that have ended.
        ready: Those that told to be ready.
        reports: Last diagnostics, by node.
        processor: Share of a core, by node.
        now: Wall time [s].
    """
    stale = silent_nodes(names, reports, now)
    rows = []
    for name in names:
        values = reports[name].values if name in reports else {}
        if name in ended:
            state = describe_exit(ended[name])
        elif name in stale:
            state = 'STALE'
        else:
            state = 'running' if name in ready else 'starting'
        rate = _number(values.get('rate_hz', '')) if state == 'running' else None
        rows.append(Row(name, state, rate, processor.get(name), _note(values)))
    return rows


def _note(values: Mapping[str, str]) -> str:
    """Return what is out of the ordinary."""
    notes = [f'waits for {values["waiting_for"]}'] if values.get('waiting_for') else []
    for key in ('solver_failures', 'slack_events', 'rejected', 'deadline_misses', 'lost'):
        if values.get(key, '0') not in ('0', ''):
            notes.append(f'{values[key]} {key.replace("_", " ")}')
    return ', '.join(notes)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def processor_shares(
    before: Mapping[str, float], after: Mapping[str, float], elapsed: float
) -> dict[str, float]:
    """Return the share of a core that each process used between two readings.

    Args:
        before, after: Processor time by process [s].
        elapsed: Wall time between the readings [s].
    """
    if elapsed <= 0.0:
        return {}
    return {name: (after[name] - before[name]) / elapsed for name in after if name in before}


def processor_time(pid: int) -> float | None:
    """Return the processor time a process has used [s], None if it has ended."""
    try:
        text = Path(f'/proc/{pid}/stat').read_text()
    except OSError:
        return None
    fields = text.rpartition(')')[2].split()  # the name may contain anything
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
