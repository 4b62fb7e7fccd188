"""`re_solve BAG [NODE ...]`: what the controllers answer to recorded inputs."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path

from layered_cbf_ros.bags.command_line import EXIT_FOUND, OneLineParser
from layered_cbf_ros.bags.json_output import add_json_option, check_json_file, tell
from layered_cbf_ros.bags.resolving.output import OutputBag
from layered_cbf_ros.bags.resolving.overrides import with_changes
from layered_cbf_ros.bags.resolving.report import text_of
from layered_cbf_ros.bags.resolving.resolving import Findings, Question, resolved_nodes
from layered_cbf_ros.bags.resolving.results import ResolveResult
from layered_cbf_ros.bags.resolving.run_setup import RunSetup, read_setup
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.errors import BagError, LayeredCbfError

DESCRIPTION = """\
Feed recorded inputs to the coordinator, the MPC, the whole-body controller or the
obstacle tracker, offline, and compare every output with the recorded one, to the bit.
With --params: what would other gains have done? With --filter off: what would the
desired motion alone have done? For these two the robots are taken to follow the new
plan exactly; controllers get their recorded inputs."""
EPILOG = """\
exit code 0: all outputs are the same to the bit, or the question is answered and no
bodies overlap; 1: outputs differ, or bodies would overlap; 2: the bag or the command
is bad, or lacks an input."""
ALL = 'all'
COORDINATOR = 'coordinator'


def main(arguments: Sequence[str]) -> int:
    """Re-solve; return the exit code.

    Raises:
        LayeredCbfError: If the bag or the command is bad.
    """
    options = _parser().parse_intermixed_args(arguments)
    check_json_file(options.json, options.force)
    result = _answer(options)
    tell(options.json, result.to_json(), text_of(result))
    found = result.overlaps if result.what_if else not result.is_equal
    return EXIT_FOUND if found else 0


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser('re_solve', DESCRIPTION, EPILOG)
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help="a bag's or a run's folder, or a file")
    add(
        'nodes',
        nargs='*',
        metavar='NODE',
        help='coordinator, obstacle_tracker, ROBOT/ground_force_mpc, ROBOT/whole_body_controller; '
        f'all of them if none or {ALL} is named',
    )
    add('--params', type=Path, metavar='FILE', help='ROS parameter file with other gains')
    add(
        '--filter',
        choices=('on', 'off'),
        default='on',
        help='off: only the coordinator, its desired motion alone',
    )
    add('--output', type=Path, metavar='DIR', help='write what was re-solved there, as a bag')
    add_json_option(parser)
    add('--force', action='store_true', help='overwrite what --output and --json name')
    processors = len(os.sched_getaffinity(0))
    add('--jobs', type=int, default=processors, metavar='N', help='processes at most')
    return parser


def _answer(options: argparse.Namespace) -> ResolveResult:
    begun_s = time.monotonic()
    setup = read_setup(open_bag(options.bag))
    nodes = _chosen(setup, options.nodes, options.filter == 'off')
    what_if = options.filter == 'off' or options.params is not None
    if options.params is not None:
        setup = with_changes(setup, options.params, nodes)
        nodes = [node for node in nodes if node in setup.changes]
    question = Question(options.bag, setup, what_if, options.filter == 'on')
    if options.output is None:
        found = resolved_nodes(question, nodes, options.jobs)
    else:
        found = _written(question, nodes, options.output, options.force)
    result = ResolveResult(
        bag=str(options.bag),
        scenario=setup.scenario.name,
        time=setup.scenario.time,
        truncated=found.truncated,
        filtered=question.filtered,
        what_if=what_if,
        wall_time_s=time.monotonic() - begun_s,
        recorded_time_s=max(node.duration_s for node in found.nodes),
        nodes=found.nodes,
    )
    if not what_if and not result.compared:
        topics = ', '.join(topic.topic for node in found.nodes for topic in node.topics)
        raise BagError(f'{options.bag} holds no output to compare with; record one of {topics}')
    return result


def _chosen(setup: RunSetup, asked: Sequence[str], unfiltered: bool) -> list[str]:
    """Return the nodes that were asked for.

    Raises:
        LayeredCbfError: If there is no such node, or it has no filter.
    """
    names = [name.strip('/') for name in asked if name != ALL]
    for name in names:
        if name not in setup.nodes:
            raise LayeredCbfError(f"no node '{name}'; there are {', '.join(setup.nodes)}, {ALL}")
    if unfiltered:
        others = [name for name in names if name != COORDINATOR]
        if others:
            raise LayeredCbfError(f'--filter off is for {COORDINATOR} only; leave {others[0]} out')
        return [COORDINATOR]
    return setup.nodes if not names or ALL in asked else list(dict.fromkeys(names))


def _written(question: Question, nodes: Sequence[str], path: Path, force: bool) -> Findings:
    """Re-solve and write the answers as a bag."""
    output = OutputBag(path, question.bag, question.setup, force)
    try:
        return resolved_nodes(question, nodes, 1, (output,))
    finally:
        output.close()
