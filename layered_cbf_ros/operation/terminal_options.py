"""The command line of `teleop`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.bags.command_line import OneLineParser
from layered_cbf_ros.errors import LayeredCbfError

RATES = 10.0, 100.0
DESCRIPTION = """\
Steer robots from a terminal, see what the safety filter makes of it, and stop them.
The keys are shown on the screen. Joy messages go to /joy; the coordinator decides."""
EPILOG = """\
With --gamepad a pad of this computer is read besides, as joy_node would; the coordinator
reads it by its joystick parameters, see params/joystick/. A screen needs a terminal; a pad
doesn't: without one, lines are printed.
exit code 0: ended by Ctrl-C or a signal, robots stop; 2: the command is wrong, or no terminal."""


@dataclass(frozen=True)
class Options:
    """What the user asks for.

    Attributes:
        robots: The robots to show and to choose from, empty for all.
        has_gamepad: Whether to read a gamepad.
        gamepad: Its device, None for the first one there is.
        rate: Messages a second while a key is held [Hz].
    """

    robots: tuple[str, ...] = ()
    has_gamepad: bool = False
    gamepad: Path | None = None
    rate: float = 30.0


def parse(arguments: Sequence[str]) -> Options:
    """Read the command line.

    Raises:
        LayeredCbfError: If it is wrong, naming the flag and the value.
    """
    parser = OneLineParser('teleop', DESCRIPTION, EPILOG)
    add = parser.add_argument
    add('--robots', type=_names, default=(), metavar='A,B', help='show and choose only these')
    add('--gamepad', nargs='?', const='', metavar='DEVICE', help='read a gamepad, the first one')
    add('--rate', type=_rate, default=30.0, metavar='HZ', help='messages a second, 30 if not given')
    given = parser.parse_args(arguments)
    device = Path(given.gamepad) if given.gamepad else None
    return Options(given.robots, given.gamepad is not None, device, given.rate)


def places_of(wanted: Sequence[str], team: Sequence[str]) -> tuple[int, ...]:
    """Return the place in the team of each robot that is wanted, all if none is named.

    Raises:
        LayeredCbfError: If there is no such robot, naming those there are.
    """
    for name in wanted:
        if name not in team:
            raise LayeredCbfError(f"--robots: no robot '{name}'; there are {', '.join(team)}")
    return tuple(team.index(name) for name in wanted or team)


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip().strip('/') for name in text.split(','))
    if not all(names) or len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f"'{text}' is no list of different names like a1_0,a1_1")
    return names


def _rate(text: str) -> float:
    low, high = RATES
    try:
        value = float(text)
    except ValueError:
        value = float('nan')
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"'{text}' is no rate from {low:g} to {high:g} Hz")
    return value
