"""`supervisor status`: its command line, what it prints, and its exit code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from layered_cbf_ros.bags.command_line import OneLineParser
from layered_cbf_ros.health import Level, Report, worst
from layered_cbf_ros.run_nodes import PLANTS
from layered_cbf_ros.supervision.status import STALE_AFTER, SUPERVISOR, Heard

WORD = 'status'
"""First argument of `supervisor` that asks for this instead of a run."""
COORDINATOR = '/coordinator'
EXIT_CODES = {Level.OK: 0, Level.WARN: 1, Level.ERROR: 2}
EXIT_NOBODY = 2
DESCRIPTION = 'Show how the nodes of a running graph fare, as they tell on /diagnostics.'
EPILOG = """\
Times are in ms. jitter: 99th percentile of the deviations of the wall time between two
ticks, from the period in real time, from its median in lockstep. p50, p99 and max: of the
time a tick takes to compute.

Exit code: 0 if all are well, 1 if somebody warns, 2 if somebody is in error or stale, or
nobody is heard. A scenario called status is started by its path, ./status."""


@dataclass(frozen=True, slots=True)
class StatusOptions:
    """What the user asks for.

    Attributes:
        watch: Show it again every second, until Ctrl-C.
        json: Print JSON instead of a table.
    """

    watch: bool = False
    json: bool = False


@dataclass(frozen=True, slots=True)
class Summary:
    """What is known of a whole run; '' where nobody tells it.

    Attributes:
        scenario: Its name.
        phase: Where its supervisor is.
        simulated: Simulated time [s].
        factor: Its rate to wall time, in the last second.
        paused: Whether the simulated time is held.
        stopped: Whether the emergency stop is latched.
    """

    scenario: str
    phase: str
    simulated: str
    factor: str
    paused: bool
    stopped: bool


def parse_status(arguments: Sequence[str]) -> StatusOptions:
    """Read the command line behind the word.

    Raises:
        BagError: If it is wrong.
    """
    parser = OneLineParser('supervisor status', DESCRIPTION, EPILOG)
    parser.add_argument('--watch', action='store_true', help='every second, until Ctrl-C')
    parser.add_argument('--json', action='store_true', help='one JSON object instead of a table')
    return StatusOptions(**vars(parser.parse_args(arguments)))


def members(heard: Mapping[str, Heard]) -> set[str]:
    """Return the nodes that belong to the run, as its supervisor tells; none without one."""
    if SUPERVISOR not in heard:
        return set()
    return set(heard[SUPERVISOR].report.values.get('nodes', '').split())


def aged(heard: Mapping[str, Heard], unheard: Sequence[str], now: float) -> list[Report]:
    """Return the reports by name; who has fallen silent, or never spoke, is stale.

    Args:
        heard: The last word of each node, or of its supervisor on it.
        unheard: Nodes that could speak and did not.
        now: Wall time [s].
    """
    reports = {name: Report(name, Level.STALE, 'tells nothing', {}) for name in unheard}
    for name, last in heard.items():
        report, age = last.report, now - last.at
        if age > STALE_AFTER and report.values.get('state') != 'ended':
            words = f'silent for {age:.0f} s'
            values = {**report.values, 'faults': words}
            report = Report(name, Level.STALE, words, values, report.hardware_id)
        reports[name] = report
    return [reports[name] for name in sorted(reports)]


def summary_of(reports: Sequence[Report]) -> Summary:
    """Gather what single nodes tell of the whole run."""
    told = {report.name: report.values for report in reports}
    supervisor = told.get(SUPERVISOR, {})
    plant = next((told[name] for name in PLANTS if name in told), {})
    return Summary(
        scenario=supervisor.get('scenario', ''),
        phase=supervisor.get('phase', ''),
        simulated=plant.get('stamp_s', ''),
        factor=plant.get('real_time_factor', ''),
        paused=plant.get('paused') == 'true',
        stopped=bool(told.get(COORDINATOR, {}).get('e_stop')),
    )


def headline(summary: Summary) -> str:
    """Return one line on the whole run."""
    parts = [summary.scenario or 'nodes without a supervisor', summary.phase]
    if summary.simulated:
        parts.append(f'{summary.simulated} s simulated')
    if summary.factor:
        parts.append(f'real-time factor {summary.factor}')
    parts += ['paused'] * summary.paused + ['EMERGENCY STOP'] * summary.stopped
    return ', '.join(part for part in parts if part)


def status_json(reports: Sequence[Report]) -> dict[str, Any]:
    """Return all that was heard, as JSON takes it; figures are as they were told."""
    summary = summary_of(reports)
    return {
        'level': worst(reports).name,
        'scenario': summary.scenario,
        'phase': summary.phase,
        'simulated_s': float(summary.simulated) if summary.simulated else None,
        'real_time_factor': float(summary.factor) if summary.factor else None,
        'paused': summary.paused,
        'e_stop': summary.stopped,
        'nodes': [
            {
                'name': report.name,
                'level': report.level.name,
                'message': report.message,
                'hardware_id': report.hardware_id,
                'values': dict(report.values),
            }
            for report in reports
        ],
    }


def exit_code(reports: Sequence[Report]) -> int:
    """Return what a script gets to know."""
    return EXIT_CODES[worst(reports)] if reports else EXIT_NOBODY


def nobody_on(domain: str) -> str:
    """Return what is said when nobody is heard."""
    return (
        f'nobody tells anything on /diagnostics of ROS_DOMAIN_ID {domain}; '
        'start a run with scripts/demo, or set ROS_DOMAIN_ID to that of the run'
    )
