"""The supervisor's command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.supervision.hosts import ALL, BASE
from layered_cbf_ros.viewing.front.options import FrontOptions, add_front_options

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
        joystick: Which preset the coordinator reads joysticks by, None for its own.
        real_time: Run against the wall clock.
        record: Record a bag and judge it.
        front: Where the page of the run is, None for no page.
        host: Whose share of the run is started, see `hosts`.
        epoch: Wall time at which the time of emulated robots begins [s], None for now.
    """

    scenario: str
    seed: int | None = None
    duration: float | None = None
    output: Path | None = None
    json: Path | None = None
    joystick: str | None = None
    real_time: bool = False
    record: bool = True
    front: FrontOptions | None = None
    host: str = ALL
    epoch: float | None = None


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
        '--joystick', metavar='PAD', help='your pad: the name of a file in params/joystick, as ps5'
    )
    parser.add_argument(
        '--real-time', action='store_true', help='run against the wall clock, not in lockstep'
    )
    parser.add_argument(
        '--no-record', dest='record', action='store_false', help='no bag, so no verdict'
    )
    parser.add_argument(
        '--viewer', action='store_true', help='a page in the browser: the run in 3D, and a stick'
    )
    add_front_options(parser, 'page-')
    parser.add_argument(
        '--host',
        default=ALL,
        metavar='NAME',
        help=f'start only the share of this computer: {BASE}, or the name of a robot',
    )
    parser.add_argument(
        '--epoch',
        type=float,
        metavar='S',
        help='Unix time at which that of emulated robots begins, the same on all hosts',
    )
    given = vars(parser.parse_args(arguments))
    front = FrontOptions(*(given.pop(f'page_{name}') for name in ('host', 'port', 'token')))
    shown = given.pop('viewer')
    if front != FrontOptions() and not shown:
        parser.error('--page-host, --page-port and --page-token want --viewer too')
    return Options(**given, front=front if shown else None)
