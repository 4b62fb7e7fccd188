"""`audit BAG`: recomputes from what was recorded whether a run kept its promises."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from layered_cbf_ros.bags.audit.audit import audit
from layered_cbf_ros.bags.audit.limits import limits_from
from layered_cbf_ros.bags.audit.report import json_of, text_of
from layered_cbf_ros.bags.command_line import OneLineParser
from layered_cbf_ros.bags.json_output import add_json_option, check_json_file, tell

DESCRIPTION = """\
Recompute from the recorded states alone, with code that does not come from the
coordinator, whether a run kept its promises: distance and surface clearance of every
pair, psi0 and psi1, plan, posture, joints, forces, stamps and ages. Each breach is told
with time, pair and value. A bag with a hole proves nothing."""
EPILOG = """\
exit code 0: all is proven and kept; 1: there is a breach; 2: not all is proven, or the
bag or the command is bad."""


def main(arguments: Sequence[str]) -> int:
    """Audit a bag; return the exit code.

    Raises:
        BagError: If there is no bag, or the report would overwrite a file.
    """
    options = _parser().parse_args(arguments)
    limits = limits_from(options.limit)
    check_json_file(options.json, options.force)
    found = audit(options.bag, limits)
    tell(options.json, json_of(found), text_of(found, options.quiet))
    return found.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser('audit', DESCRIPTION, EPILOG)
    parser.add_argument('bag', type=Path, metavar='BAG', help="a bag's or a run's folder, a file")
    add_json_option(parser)
    parser.add_argument(
        '--limit',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='change a limit; the report lists them with their units',
    )
    parser.add_argument('--force', action='store_true', help='overwrite FILE')
    parser.add_argument(
        '--quiet', action='store_true', help='only breaches, holes and the judgement'
    )
    return parser
