"""The command line of `replay`: flags as users of `ros2 bag play` know them."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from layered_cbf_ros.bags.command_line import OneLineParser
from layered_cbf_ros.bags.playback.selection import Selection, parse_remap
from layered_cbf_ros.bags.topic_selection import full_name
from layered_cbf_ros.errors import BagError

CLOCK_HZ = 40.0
ACKNOWLEDGED_MS = 5000  # readers answer a heartbeat, which comes every 3 s
DESCRIPTION = """\
Send the messages of a bag again: the recorded bytes, in the recorded order and rhythm, with
the recorded quality of service. The bag may be mcap or sqlite3, whoever recorded it.
keys: space pauses and goes on, right arrow sends one message while paused, up and down
arrow change the rate by a tenth, q or Ctrl-C ends."""
EPILOG = """\
To let a live node work on recorded inputs, start it by itself, then
  replay RUN --inputs-of coordinator        (or a1_0/ground_force_mpc, obstacle_tracker, ...)
It waits until the node listens, stands for the partners that the node waits for in lockstep,
and does not run ahead of the node's answers: a slow node delays it and loses nothing. In
lockstep a node answers as in the run, to the bit; with -p time:=real_time, nearly so.
exit code 0: all was played; 2: the bag or the command is bad, the bag is cut off, or a topic
could not be played; 130: ended by q, Ctrl-C or a signal."""


@dataclass(frozen=True)
class Options:
    """What the user asks for; times in seconds.

    Attributes:
        bag: The bag.
        rate: Seconds of bag time in one second.
        selection: Which topics, under which names.
        loop: Begin again at the end.
        clock_hz: Rate of /clock [Hz], 0 for none.
        delay: Before each round.
        start_offset: What is left out at the begin.
        playback_duration: Bag time to play, infinite for all.
        start_paused: Wait for a key first.
        keyboard: Obey keys.
        acknowledged_ms: How long to wait at the end for readers [ms], 0 for ever.
        inputs_of: Play only what this node acts on, '' for everything.
        following: Wait for that node's answers.
    """

    bag: Path
    rate: float = 1.0
    selection: Selection = field(default_factory=Selection)
    loop: bool = False
    clock_hz: float = 0.0
    delay: float = 0.0
    start_offset: float = 0.0
    playback_duration: float = math.inf
    start_paused: bool = False
    keyboard: bool = True
    acknowledged_ms: int = ACKNOWLEDGED_MS
    inputs_of: str = ''
    following: bool = True


def parse(arguments: Sequence[str]) -> Options:
    """Read the command line.

    Raises:
        BagError: If it is wrong, naming the flag and the value.
    """
    given = _parser().parse_args(arguments)
    selection = Selection(
        tuple(map(full_name, given.topics)),
        given.regex,
        tuple(map(full_name, given.exclude_topics)),
        given.exclude_regex,
        parse_remap(given.remap),
    )
    if given.inputs_of and (given.topics or given.regex):
        raise BagError('--inputs-of chooses the topics; leave out --topics and --regex')
    if given.inputs_of and given.loop:
        raise BagError('--inputs-of with --loop: stamps would go back, which nodes refuse; choose')
    return Options(
        given.bag,
        given.rate,
        selection,
        given.loop,
        given.clock,
        given.delay,
        given.start_offset,
        given.playback_duration,
        given.start_paused,
        not given.disable_keyboard_controls,
        given.wait_for_all_acked,
        given.inputs_of,
        given.following,
    )


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser('replay', DESCRIPTION, EPILOG)
    parser.add_argument('bag', type=Path, metavar='BAG', help="a bag's or a run's folder, a file")
    _add_topics(parser)
    _add_times(parser)
    add = parser.add_argument
    add('-l', '--loop', action='store_true', help='begin again at the end, without end')
    add('-p', '--start-paused', action='store_true', help='wait for a key before the first message')
    add('--disable-keyboard-controls', action='store_true', help='obey no keys')
    add('-s', '--storage', metavar='ID', help='for habit: the kind of bag is found out anyway')
    return parser


def _add_topics(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    topics = {'nargs': '+', 'default': [], 'metavar': 'TOPIC'}
    add('--topics', help='play only these', **topics)  # type: ignore[arg-type]
    add('--exclude-topics', help='do not play these', **topics)  # type: ignore[arg-type]
    for short, long, text in (
        ('-e', '--regex', 'play topics in whose names this is found, beside --topics'),
        ('-x', '--exclude-regex', 'do not play topics in whose names this is found'),
    ):
        add(short, long, type=_regex, default='', metavar='REGEX', help=text)
    rules = 'send topics under other names'
    add('-m', '--remap', nargs='+', default=[], metavar='OLD:=NEW', help=rules)
    node = 'play only what this node acts on, into the live node'
    add('--inputs-of', default='', metavar='NODE', help=node)
    freely = "do not wait for that node's answers: it may skip inputs, as on a slow computer"
    add('--no-following', dest='following', action='store_false', help=freely)


def _add_times(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    above, least = _number(above=0.0), _number(least=0.0)
    rate = 'seconds of bag time in one second, 1 if not given'
    add('-r', '--rate', type=above, default=1.0, metavar='FACTOR', help=rate)
    add('-d', '--delay', type=least, default=0.0, metavar='S', help='wait before each round [s]')
    add(
        '--start-offset', type=least, default=0.0, metavar='S',
        help='leave out so much of the begin [s]; latched topics are sent all the same',
    )  # fmt: skip
    length = 'bag time to play [s]'
    add('--playback-duration', type=above, default=math.inf, metavar='S', help=length)
    add(
        '--clock', type=above, nargs='?', const=CLOCK_HZ, default=0.0, metavar='HZ',
        help=f'publish /clock in bag time, {CLOCK_HZ:g} times a second if no rate is given',
    )  # fmt: skip
    add(
        '--wait-for-all-acked', type=_milliseconds, default=ACKNOWLEDGED_MS, metavar='MS',
        help='longest wait at the end for readers to have everything [ms], '
        f'{ACKNOWLEDGED_MS} if not given, 0 for ever',
    )  # fmt: skip


def _number(above: float | None = None, least: float = -math.inf) -> Callable[[str], float]:
    """Return a reader of finite numbers above, or at least, a bound."""

    def read(text: str) -> float:
        bound = f'above {above:g}' if above is not None else f'of at least {least:g}'
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < least or (above is not None and value <= above):
            raise argparse.ArgumentTypeError(f"'{text}' is no number {bound}")
        return value

    return read


def _milliseconds(text: str) -> int:
    return round(_number(least=0.0)(text))


def _regex(text: str) -> str:
    try:
        re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"'{text}' is no regular expression: {error}") from None
    return text
