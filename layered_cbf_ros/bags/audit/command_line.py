"""`audit BAG`: recomputes from what was recorded whether a run kept its promises."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from layered_cbf_ros.bags.audit.audit import audit
from layered_cbf_ros.bags.audit.limits import limits_from
from layered_cbf_ros.bags.audit.report import json_of, text_of
from layered_cbf_ros.errors import BagError

DESCRIPTION = """\
Recompute from the recorded states alone, with code that does not come from the
coordinator, whether a run kept its promises: distance and surface clearance of every
pair, psi0 and psi1, plan, posture, joints, forces, stamps and ages. Each breach is told
with time, pair and value. A bag with a hole proves nothing."""
EPILOG = """\
exit code 0: all is proven and kept; 1: there is a breach; 2: not all is proven, or the
bag or the command is bad."""
STANDARD_OUTPUT = Path('-')


def main(arguments: Sequence[str]) -> int:
    """Audit a bag; return the exit code.

    Raises:
        BagError: If there is no bag, or the report would overwrite a file.
    """
    options = _parser().parse_args(arguments)
    limits = limits_from(options.limit)
    if options.json not in (None, STANDARD_OUTPUT):
        _check_writable(options.json, options.force)
    found = audit(options.bag, limits)
    text = json.dumps(json_of(found), indent=2, allow_nan=False)
    if options.json == STANDARD_OUTPUT:
        print(text)
        return found.exit_code
    if options.json is not None:
        _write(options.json, text)
    print(text_of(found, options.quiet))
    return found.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='audit',
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('bag', type=Path, metavar='BAG', help="a bag's or a run's folder, a file")
    parser.add_argument(
        '--json',
        type=Path,
        nargs='?',
        const=STANDARD_OUTPUT,
        metavar='FILE',
        help='write all findings there as JSON; without FILE print JSON instead of the report',
    )
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


def _check_writable(path: Path, force: bool) -> None:
    """Refuse a file that can't be written, before the work begins.

    Raises:
        BagError: If it exists and may not be overwritten, or its folder doesn't.
    """
    if path.exists() and not force:
        raise BagError(f'--json {path} exists already; give another file, or --force')
    if path.is_dir() or not path.parent.is_dir():
        raise BagError(f'--json {path} cannot be written; give a file in a folder that exists')


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise BagError(f'--json {path} cannot be written: {error.strerror}') from None
