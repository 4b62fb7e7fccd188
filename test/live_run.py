"""A supervisor as a process of its own, with everything that it starts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from live_node import DOMAIN

ENVIRONMENT = os.environ | {'OMP_NUM_THREADS': '1', 'ROS_DOMAIN_ID': str(DOMAIN)}
LIMIT_S = 600.0


class LiveRun:
    """A running supervisor, and what it prints.

    Attributes:
        output: Folder of the run.
        said: What it has printed so far.
        children: Process numbers of the nodes, by their names, once they run.
    """

    def __init__(self, scenario: Path | str, output: Path, *options: str) -> None:
        self.output = output
        program = 'from layered_cbf_ros.nodes.supervisor import main; main()'
        self.process = subprocess.Popen(
            [sys.executable, '-c', program, str(scenario), '--output', str(output), *options],
            env=ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.said = ''
        self.children: dict[str, int] = {}

    def until_running(self) -> None:
        """Read on until all nodes are ready, and note which processes they are."""
        while not self.said.endswith('running\n'):
            line = self.process.stdout.readline()
            assert line, self.said
            self.said += line
        pid = self.process.pid
        for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split():
            words = Path(f'/proc/{child}/cmdline').read_text()
            node = words.partition('nodes.')[2].partition(' ')[0]
            namespace = words.partition('__ns:=')[2].partition('\0')[0]
            self.children[f'{namespace}/{node}'] = int(child)
        time.sleep(1.5)  # one round of the supervisor's bookkeeping

    def end(self) -> int:
        """Read all that it says; return its exit code."""
        self.said += self.process.communicate(timeout=LIMIT_S)[0]
        return self.process.returncode

    def summary(self) -> dict:
        return json.loads((self.output / 'summary.json').read_text())


def is_alive(pid: int) -> bool:
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


def wait_until_gone(pids) -> None:
    end = time.monotonic() + LIMIT_S
    while any(is_alive(pid) for pid in pids):
        assert time.monotonic() < end, 'an orphan lives on'
        time.sleep(0.05)
