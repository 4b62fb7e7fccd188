"""The supervisor's command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

DEFAULT_SCENARIO = 'one_agent_three_obstacles'
DESCRIPTION = 'Run a scenario through the whole node graph, record it and judge it.'


@dataclass(frozen=True, slots=True)
class Options:
    """What the user asks for.

    Attributes:
        scenario: Name or path of the scenario.
        seed, duration: Other ones than the scenario's, if not None.
        output: Folder of the run, None for a new one below `runs/`.
        json: Where the summary goes too, if not None.
        real_time: Run against the wall clock.
        record: Record a bag and judge it.
    """

    scenario: str
    seed: int | None = None
    duration: float | None = None
    output: Path | None = None
    json: Path | None = None
    real_time: bool = False
    record: bool = True


def parse(arguments: Sequence[str]) -> Options:
    """Read the command line; exits with a message if it is wrong."""
    parser = argparse.ArgumentParser(
        prog='supervisor',
        description=DESCRIPTION,
        epilog='The exit code is 0 only if the run came to its end and its verdict is good.',
    )
    parser.add_argument(
        'scenario',
        metavar='SCENARIO',
        nargs='?',
        default=DEFAULT_SCENARIO,
        help=f'name or path of a scenario file, {DEFAULT_SCENARIO} if none is given',
    )
    parser.add_argument('--seed', type=int, metavar='N', help='seed of everything random')
    parser.add_argument('--duration', type=float, metavar='S', help='longest simulated time [s]')
    parser.add_argument('--output', type=Path, metavar='DIR', help='folder of the run')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the summary there too')
    parser.add_argument(
        '--real-time', action='store_true', help='run against the wall clock, not in lockstep'
    )
    parser.add_argument(
        '--no-record', dest='record', action='store_false', help='no bag, so no verdict'
    )
    return Options(**vars(parser.parse_args(arguments)))
