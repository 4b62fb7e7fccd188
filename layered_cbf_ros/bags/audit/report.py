"""An audit as text for people and as plain values for programs."""

from __future__ import annotations

import dataclasses
from typing import Any

from layered_cbf_ros.bags.audit.audit import Audit
from layered_cbf_ros.bags.audit.findings import BREACH, NOT_PROVEN, OK, Breach, Check
from layered_cbf_ros.bags.audit.limits import described
from layered_cbf_ros.bags.json_output import finite
from layered_cbf_ros.bags.tables import underlined

HEADING = ('check', 'worst', 'limit', 'where', 'when', 'breaches', '')
OF_PAIRS = ('centre distance', 'clearance', 'psi0 recomputed', 'psi1 recomputed')
MOST_BREACHES = 20
"""Breaches of one check that are listed as text; JSON has all."""

JUDGEMENTS = {
    OK: 'PROVEN: every promise was kept at every sample',
    BREACH: 'BREACH: {breaches} intervals break a limit',
    NOT_PROVEN: 'NOT PROVEN: nothing recorded breaks a limit, but the bag has holes',
}


def text_of(audit: Audit, quiet: bool) -> str:
    """Return the report.

    Args:
        audit: What was found.
        quiet: Leave out table, notes and limits.
    """
    lines = [f'{audit.bag}: {audit.scenario or "scenario unknown"}, {audit.duration_s:.3f} s', '']
    if not quiet:
        lines += [*_table(audit.checks), '']
        lines += _titled('smallest values of each pair', _pairs(audit.checks))
        lines += _titled('notes', [f'{c.name}: {note}' for c in audit.checks for note in c.notes])
        lines += _titled('limits that can be changed (--limit NAME=VALUE)', described(audit.limits))
    lines += _titled('breaches', [line for c in audit.checks for line in _breaches(c)])
    lines += _titled('not proven', [f'{c.name}: {hole}' for c in audit.checks for hole in c.holes])
    return '\n'.join([*lines, judgement(audit)])


def judgement(audit: Audit) -> str:
    """Return the last line of the report."""
    count = sum(len(check.breaches) for check in audit.checks)
    line = JUDGEMENTS[audit.status].format(breaches=count)
    holes = sum(len(check.holes) for check in audit.checks)
    return f'{line}; and {holes} things are NOT PROVEN' if count and holes else line


def json_of(audit: Audit) -> dict[str, Any]:
    """Return the audit as plain values for json.dumps; what is not finite becomes None."""
    return {
        'bag': audit.bag,
        'scenario': audit.scenario,
        'duration_s': audit.duration_s,
        'status': audit.status,
        'exit_code': audit.exit_code,
        'limits': dataclasses.asdict(audit.limits),
        'checks': [finite(_fields(check)) for check in audit.checks],
    }


def _fields(check: Check) -> dict[str, Any]:
    return {**dataclasses.asdict(check), 'status': check.status}


def _table(checks: tuple[Check, ...]) -> list[str]:
    return underlined([HEADING, *(_row(check) for check in checks)])


def _row(check: Check) -> tuple[str, ...]:
    worst, judged = check.worst, str(len(check.breaches)) if check.relation else ''
    if worst is None:
        return (check.name, '-', '', '', '', judged, check.status)
    return (
        check.name,
        f'{_number(worst.value)} {check.unit}'.rstrip(),
        f'{check.relation} {_number(worst.limit)}' if check.relation else '',
        worst.subject,
        f'{worst.time_s:.3f} s',
        judged,
        check.status,
    )


def _pairs(checks: tuple[Check, ...]) -> list[str]:
    """Return the smallest value of each pair, for the checks that know pairs."""
    chosen = [check for check in checks if check.name in OF_PAIRS]
    found = {check.name: {w.subject: w.value for w in check.worsts} for check in chosen}
    pairs = dict.fromkeys(pair for values in found.values() for pair in values)
    if not pairs:
        return []
    rows = [('pair', *(f'{check.name} [{check.unit}]' for check in chosen))]
    for pair in pairs:
        values = (found[check.name].get(pair) for check in chosen)
        rows.append((pair, *('-' if value is None else f'{value:.4f}' for value in values)))
    return underlined(rows)


def _breaches(check: Check) -> list[str]:
    lines = [_line(check, breach) for breach in check.breaches[:MOST_BREACHES]]
    left = len(check.breaches) - MOST_BREACHES
    return [*lines, f'{check.name}: {left} more, see --json'] if left > 0 else lines


def _line(check: Check, breach: Breach) -> str:
    when = f'{breach.start_s:.3f} s'
    if breach.samples > 1:
        when = f'{breach.start_s:.3f} to {breach.end_s:.3f} s ({breach.samples} samples)'
    must = f'must be {check.relation} {_number(breach.limit)}'
    return f'{check.name}: {when}, {breach.subject}: {_number(breach.value)} {check.unit}, {must}'


def _number(value: float) -> str:
    """Return a number with as many digits as tell it from its limit."""
    return f'{value:.6g}'


def _titled(title: str, lines: list[str]) -> list[str]:
    return [f'{title}:', *(f'  {line}' for line in lines), ''] if lines else []
