"""The whole node graph: both scenarios of the paper as a user starts them.

The figures depend on the machine and its load, but for falls and contacts.
"""

from __future__ import annotations

import functools
import json
import math
import os
import subprocess
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.row import Row
from layered_cbf_ros.bags.storage.opening import open_bag

SHORT = 10.0  # simulated time, unless the full run is asked for [s]
PERIOD = 1.0  # between samples of the memory [s]
PATIENCE = 30.0  # for an interrupted run to end in order [s]
MIB = 2.0**20
FACTORS = {'one_agent_three_obstacles': (0.4, 1.0), 'four_agents': (0.2, 0.5)}
"""Real-time factors: must and stretch."""


def graph_rows(scenario: str, supervisor: list[str], full: bool) -> list[Row]:
    """Run a scenario and return its figures.

    Args:
        scenario: Its name.
        supervisor: The command that starts the supervisor.
        full: Run it to its end, not only for its first seconds.
    """
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder, 'run')
        command = [*supervisor, scenario, '--output', str(run)]
        command += [] if full else ['--duration', str(SHORT)]
        said, memory = run_and_sample(command, Path(folder, 'said.txt'))
        summary = run / 'summary.json'
        figures = json.loads(summary.read_text()) if summary.exists() else {'outcome': 'failed'}
        if figures['outcome'] != 'finished':
            reason = figures.get('reason') or said.strip().rpartition('\n')[2]
            return [Row(f'{scenario}: {reason}', math.nan, '', 0.0)]
        return [
            *_figure_rows(scenario, figures, memory),
            *_solve_rows(scenario, run / 'bag'),
        ]


def run_and_sample(command: list[str], output: Path) -> tuple[str, float]:
    """Run a command; return what it printed and its processes' peak memory [bytes]."""
    variables = dict(os.environ)
    variables.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    peak = 0.0
    with (
        output.open('w', encoding='utf-8') as stream,
        subprocess.Popen(command, env=variables, stdout=stream, stderr=stream) as process,
    ):
        try:
            while process.poll() is None:
                family = [process.pid, *descendants(process.pid)]
                peak = max(peak, sum(map(proportional_set, family)))
                time.sleep(PERIOD)
        finally:
            process.terminate()  # does nothing to one that has ended
            process.wait(PATIENCE)
    return output.read_text(encoding='utf-8'), peak


def descendants(pid: int) -> list[int]:
    """Return the process ids of a process's children, their children and so on."""
    found = []
    for tasks in Path(f'/proc/{pid}/task').glob('*/children'):
        try:
            children = [int(word) for word in tasks.read_text().split()]
        except OSError:  # it has just ended
            continue
        for child in children:
            found += [child, *descendants(child)]
    return found


def proportional_set(pid: int) -> float:
    """Return a process's memory, shared pages divided among who shares them [bytes]."""
    try:
        lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()
    except OSError:  # it has just ended
        return 0.0
    return sum(1024.0 * float(line.split()[1]) for line in lines if line.startswith('Pss:'))


def _figure_rows(scenario: str, figures: Mapping[str, Any], memory: float) -> list[Row]:
    must, stretch = FACTORS[scenario]
    factor, simulated = figures['real_time_factor'], figures['sim_time_s']
    row = functools.partial(Row, physical=False)
    return [
        Row(f'{scenario}: falls', figures['falls'], '', 0.0),
        Row(f'{scenario}: contacts', figures['contacts'], '', 0.0),
        Row(f'{scenario}: solver failures', figures['solver_failures'], '', 0.0),
        row(f'{scenario}: real-time factor', factor, '', must, stretch, at_least=True),
        row(f'{scenario}: peak memory', memory / MIB, 'MiB', 2048.0, 1024.0),
        row(f'{scenario}: messages per simulated s', figures['messages'] / simulated, ''),
    ]


def _solve_rows(scenario: str, bag: Path) -> list[Row]:
    """Return each kind of node's time per tick as it told itself; of several the slowest."""
    told: dict[str, dict[str, str]] = {}
    for _, message in open_bag(bag).messages(['/diagnostics']):
        for status in message.status:
            told[status.name] = {entry.key: entry.value for entry in status.values}
    slowest: dict[str, tuple[float, float]] = {}
    for name, values in told.items():
        times = [float(values.get(f'solve_time_{which}_us', 'nan')) for which in ('p50', 'p99')]
        kind = name.rpartition('/')[2]
        if times[0] > 0.0:
            slowest[kind] = max(slowest.get(kind, (0.0, 0.0)), (times[0], times[1]))
    return [
        Row(f'{scenario}: {kind} tick', p50, 'us', physical=False, details={'p99': p99})
        for kind, (p50, p99) in sorted(slowest.items())
    ]
