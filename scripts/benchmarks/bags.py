"""The programs that read bags: what a minute of a run costs them, in time and memory.

A short run is recorded; what a minute takes lies on the line through the costs of its
bag and of the first part of that. The figures depend on the machine and its load; none
fails the benchmark.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.graph import run_and_sample
from benchmarks.row import Row
from layered_cbf_ros.bags.run.run_record import load_run

SCENARIO = 'four_agents'
DURATION = 10.0  # of the run that is recorded [s]
MINUTE = 60.0
MIB = 2.0**20
JUDGED = (0, 1)  # exit codes of a program that did its work
PART = 8  # the shorter bag is this part of the other
LIMITS = {'inspect': ((20.0, 8.0), (1024.0, 400.0)), 'audit': ((None, None), (None, None))}
"""Must and stretch of the time [s] and of the memory [MiB] for a minute."""


@dataclass(frozen=True)
class Cost:
    """What one process took for a bag.

    Attributes:
        simulated: Length of the run in the bag [s].
        seconds: Wall time [s].
        memory: Peak resident set [MiB].
        code: Exit code.
    """

    simulated: float
    seconds: float
    memory: float
    code: int

    def for_a_minute(self, shorter: Cost) -> Cost:
        """Return what a minute takes, on the line through this cost and that of a shorter bag."""
        factor = (MINUTE - self.simulated) / (self.simulated - shorter.simulated)
        return Cost(
            MINUTE,
            self.seconds + factor * max(0.0, self.seconds - shorter.seconds),
            self.memory + factor * max(0.0, self.memory - shorter.memory),
            self.code,
        )


def bag_rows(programs: Mapping[str, Sequence[str]], supervisor: Sequence[str]) -> list[Row]:
    """Record a short run of four robots, and return what each program takes for its bag.

    Args:
        programs: The command that starts each program of LIMITS, by its name.
        supervisor: The command that starts the supervisor.
    """
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder, 'run')
        options = ['--output', str(run), '--duration', str(DURATION)]
        said, _ = run_and_sample([*supervisor, SCENARIO, *options], Path(folder, 'said.txt'))
        summary = run / 'summary.json'
        figures = json.loads(summary.read_text()) if summary.exists() else {}
        if not figures.get('sim_time_s'):
            reason = figures.get('reason') or said.strip().rpartition('\n')[2]
            return [Row(f'bags: {reason}', math.nan, physical=False)]
        bags = cut(run / 'bag', Path(folder, 'part.mcap')), run / 'bag'
        return [row for name in programs for row in _rows(name, programs[name], *bags)]


def cut(bag: Path, part: Path) -> Path:
    """Write the first part of a bag, as if its recorder had been killed; return its path."""
    (file,) = bag.glob('*.mcap')
    data = file.read_bytes()
    part.write_bytes(data[: len(data) // PART])
    return part


def cost_of(command: Sequence[str], bag: Path) -> Cost:
    """Run a program on a bag, silently; return what it took."""
    record = load_run(bag)
    simulated = 0.0 if record.state is None else float(record.seconds(record.state.stamps_ns)[-1])
    del record
    began = time.monotonic()
    with subprocess.Popen(
        [*command, str(bag)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds, memory = time.monotonic() - began, usage.ru_maxrss * 1024.0 / MIB
    return Cost(simulated, seconds, memory, process.returncode)


def _rows(name: str, command: Sequence[str], part: Path, bag: Path) -> list[Row]:
    """Return time and memory of one program for a minute of the run."""
    shorter, taken = cost_of(command, part), cost_of(command, bag)
    minute = taken.for_a_minute(shorter)
    if taken.code not in JUDGED:
        minute = Cost(MINUTE, math.nan, math.nan, taken.code)
    (slow, aim), (large, small) = LIMITS[name]
    length = {'of a run of s': taken.simulated}
    return [
        Row(
            f'{name}: a minute of four robots', minute.seconds, 's', slow, aim, physical=False,
            details={'measured': taken.seconds, **length},
        ),
        Row(
            f'{name}: peak memory of that', minute.memory, 'MiB', large, small, physical=False,
            details={'measured': taken.memory, **length},
        ),
    ]  # fmt: skip
