"""The state of every node of a run: what it tells, or what its supervisor knows of it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.health import TOLD_BY, Fault, Level, Report
from layered_cbf_ros.supervision.child import describe_exit

STALE_AFTER = 3.0
"""A running node whose diagnostics are older is not trusted any more [s]."""
SUPERVISOR = '/supervisor'


@dataclass(frozen=True, slots=True)
class Heard:
    """The last diagnostics of a node.

    Attributes:
        report: What it told.
        at: Wall time when that came [s].
    """

    report: Report
    at: float


def silent_nodes(names: Sequence[str], heard: Mapping[str, Heard], now: float) -> list[str]:
    """Return the nodes whose diagnostics have stopped."""
    return [name for name in names if name in heard and now - heard[name].at > STALE_AFTER]


def reports_of_run(
    names: Sequence[str],
    ended: Mapping[str, int],
    heard: Mapping[str, Heard],
    now: float,
) -> list[Report]:
    """Return what is known of each node of a run: by itself, or else by its supervisor.

    Of a node that is silent or dead the last figures are told again, so that no counter
    seems to fall, and no evidence is lost. A node that ended in order keeps its last word.

    Args:
        names: All nodes of the run.
        ended: Exit codes of those that have ended.
        heard: Last diagnostics, by node.
        now: Wall time [s].
    """
    silent = silent_nodes(names, heard, now)
    reports = []
    for name in names:
        last = heard[name].report if name in heard else Report(name, Level.OK, '', {})
        if ended.get(name):
            reports.append(_told_of(last, Level.ERROR, 'ended', describe_exit(ended[name])))
        elif name in silent and name not in ended:
            words = f'silent for {now - heard[name].at:.0f} s'
            reports.append(_told_of(last, Level.STALE, 'silent', words))
        elif name in heard:
            reports.append(last)
        else:
            state = 'ended' if name in ended else 'starting'
            reports.append(_told_of(last, Level.OK, state, ''))
    return reports


def is_told_of(report: Report) -> bool:
    """Tell whether somebody else than the node itself reports it."""
    return bool(report.values.get(TOLD_BY))


def _told_of(last: Report, level: Level, state: str, words: str) -> Report:
    values = {**last.values, 'state': state, 'faults': words, TOLD_BY: SUPERVISOR}
    return Report(last.name, level, words, values, last.hardware_id)


def faults_of_run(reports: Sequence[Report]) -> tuple[Fault, ...]:
    """Return what a supervisor knows to be wrong: nodes that can't tell it any more."""
    return tuple(
        Fault(report.name, min(report.level, Level.ERROR), f'{report.name} {report.message}')
        for report in reports
        if is_told_of(report) and report.level > Level.OK
    )


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
