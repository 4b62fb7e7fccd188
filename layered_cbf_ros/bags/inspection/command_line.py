"""`inspect BAG`: tells what is in a bag, as a table, messages, figures, files or a video."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from layered_cbf_ros.bags.command_line import EXIT_BAD_INPUT, OneLineParser
from layered_cbf_ros.bags.inspection.bag_info import BagInfo
from layered_cbf_ros.bags.inspection.echo import echo
from layered_cbf_ros.bags.inspection.export import check_tables, export
from layered_cbf_ros.bags.inspection.info_table import info_lines
from layered_cbf_ros.bags.inspection.plotting import check_figures, write_figures
from layered_cbf_ros.bags.inspection.selection import Selection
from layered_cbf_ros.bags.inspection.survey import survey
from layered_cbf_ros.bags.inspection.tables import FORMATS
from layered_cbf_ros.bags.inspection.video_option import (
    add_video_options,
    check_video_options,
    make_video,
)
from layered_cbf_ros.bags.json_output import (
    STANDARD_OUTPUT,
    add_json_option,
    check_json_file,
    finite,
    tell,
)
from layered_cbf_ros.bags.run.verdict import Verdict
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.bags.storage.repair import repair
from layered_cbf_ros.errors import BagError

DESCRIPTION = """\
Tell what is in a bag: files, time, topics with their rates and gaps, and, if it is the bag
of a run, how that went. Any mcap or sqlite3 bag will do, whoever recorded it, cut off or not."""
EPILOG = """\
examples:
  inspect RUN                                  what is in it, and the verdict
  inspect RUN --topic /state --count 2         messages, as `ros2 topic echo` shows them
  inspect RUN --topic /clock --json | jq .     the same for programs, an object a line
  inspect RUN --plot                           figures and a report, in RUN_figures/
  inspect RUN --export csv --topic /state      a table a topic, in RUN_csv/
  inspect RUN --video run.mp4 --follow a1_0    what it looked like; or run.gif
exit code 0: the bag is sound, whatever the run was like; 2: the bag or the command is bad."""


def main(arguments: Sequence[str]) -> int:
    """Inspect a bag; return the exit code.

    Raises:
        BagError: If there is no bag, the command is bad, or something would be overwritten.
    """
    options = _parser().parse_args(arguments)
    check_video_options(options)
    if options.video is not None:
        make_video(options)
        return 0
    selection = _selection(options)
    if options.repair:
        for line in repair(options.bag, options.force).lines():
            print(line)
        return 0
    bag = open_bag(options.bag)
    if options.topic and not options.export:
        return _exit_code(echo(bag, selection, options.json is not None, print))
    return _inspect(options, bag, selection)


def _inspect(options: argparse.Namespace, bag: Bag, selection: Selection) -> int:
    """Do all that isn't printing messages."""
    check_json_file(options.json, options.force)
    figures = Path(options.plot) if options.plot else _beside(options.bag, 'figures')
    tables = options.output or _beside(options.bag, options.export)
    if options.plot is not None:
        check_figures(figures, options.force)
    if options.export:
        selection.check(bag)
        topics = selection.topics or tuple(bag.topics)
        check_tables(tables, topics, options.export, options.force)
    found = survey(options.bag, bag)
    info, verdict, problems = found.info, found.verdict(), list(found.problems)
    if options.json != STANDARD_OUTPUT:
        print(*info_lines(info), sep='\n')
        if verdict is not None:
            print(f'\n{verdict.table()}')
    written = write_figures(found, verdict, figures) if options.plot is not None else []
    del found  # a minute of four robots is large
    if options.export:
        files, more = export(bag, selection, options.export, tables)
        written, problems = written + files, problems + more
    if options.json is not None:
        listed = [*written, options.json]
        tell(options.json, _document(info, verdict, problems, written), _listed(listed))
    elif written:
        print(_listed(written))
    return _exit_code(problems)


def _listed(written: Sequence[Path]) -> str:
    """Return which files were written, as text."""
    return '\n'.join(['\nwritten:', *(f'  {path}' for path in written)])


def _document(
    info: BagInfo, verdict: Verdict | None, problems: list[str], written: list[Path]
) -> dict[str, Any]:
    """Return all that was found as plain values, as JSON takes them."""
    document = {
        'info': info.to_json(),
        'problems': problems,
        'summary': None if verdict is None else verdict.to_json(),
        'written': [str(path) for path in written],
    }
    return dict(finite(document))


def _exit_code(problems: Sequence[str]) -> int:
    """Tell what is wrong, behind all that was printed; return the exit code."""
    sys.stdout.flush()
    for problem in problems:
        print(f'ERROR {problem}', file=sys.stderr)
    return EXIT_BAD_INPUT if problems else 0


def _beside(bag: Path, what: str | None) -> Path:
    """Return a folder beside a bag: `run_1_figures` beside `run_1` or `run_1.mcap`."""
    path = bag.resolve()
    return path.with_name(f'{path.name if path.is_dir() else path.stem}_{what}')


def _selection(options: argparse.Namespace) -> Selection:
    """Return which messages are asked for.

    Raises:
        BagError: If a number is out of its range, or options don't go together.
    """
    for name, least in (('count', 1), ('start_offset', 0.0), ('playback_duration', 0.0)):
        value, flag = getattr(options, name), '--' + name.replace('_', '-')
        if value is None:
            continue
        if not least <= value < math.inf:
            raise BagError(f'{flag} is {value}; give a number from {least:g} on')
        if not (options.topic or options.export):
            raise BagError(f'{flag} chooses messages; give --topic or --export too')
    if options.topic and options.plot is not None and not options.export:
        raise BagError('--topic prints messages, --plot draws; give one of them')
    if options.topic and not options.export and options.json not in (None, STANDARD_OUTPUT):
        raise BagError(f'--json {options.json}: with --topic, send the output there by `>`')
    if options.output is not None and not options.export:
        raise BagError(f'--output {options.output} is for --export; give --export csv or parquet')
    if options.repair and (options.topic or options.export or options.plot is not None):
        raise BagError('--repair stands alone; repair the bag first, then inspect it')
    duration = options.playback_duration
    return Selection(
        tuple(options.topic),
        options.count,
        options.start_offset or 0.0,
        math.inf if duration is None else duration,
    )


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser('inspect', DESCRIPTION, EPILOG)
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help="a bag's or a run's folder, an mcap or db3 file")
    add('--topic', nargs='+', default=[], metavar='T', help='print (or export) its messages')
    add('--count', type=int, metavar='N', help='at most so many messages')
    add('--start-offset', type=float, metavar='S', help='leave out the first seconds of the bag')
    add('--playback-duration', type=float, metavar='S', help='only so many seconds from there on')
    add(
        '--plot', nargs='?', const='', metavar='DIR',
        help='write figures and report.html, by default to BAG_figures beside the bag',
    )  # fmt: skip
    add(
        '--export', choices=sorted(FORMATS),
        help='write a table a topic: a row a message, of trajectories a row a point',
    )  # fmt: skip
    add('--output', type=Path, metavar='DIR', help='of --export; by default BAG_csv beside the bag')
    add_json_option(parser)
    add_video_options(parser)
    add('--repair', action='store_true', help='finish a bag that was cut off, where it is')
    add('--force', action='store_true', help='overwrite files; repair what is being recorded')
    return parser
