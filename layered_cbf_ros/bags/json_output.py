"""--json of the programs that judge: into a file beside the report, or instead of it."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from layered_cbf_ros.errors import BagError

STANDARD_OUTPUT = Path('-')


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add --json [FILE]."""
    parser.add_argument(
        '--json',
        type=Path,
        nargs='?',
        const=STANDARD_OUTPUT,
        metavar='FILE',
        help='write all findings there as JSON; without FILE print JSON instead of the report',
    )


def check_json_file(path: Path | None, force: bool) -> None:
    """Refuse a file that can't be written, before the work begins.

    Raises:
        BagError: If it exists and may not be overwritten, or its folder doesn't.
    """
    if path is None or path == STANDARD_OUTPUT:
        return
    if path.is_dir() or not path.parent.is_dir():
        raise BagError(f'--json {path} cannot be written; give a file in a folder that exists')
    if path.exists() and not force:
        raise BagError(f'--json {path} exists already; give another file, or --force')


def tell(path: Path | None, document: Any, text: str) -> None:
    """Print the report, and write the document where it was asked for.

    Args:
        path: What --json named, None without it.
        document: Plain values.
        text: The report for a person.

    Raises:
        BagError: If the file can't be written.
    """
    written = json.dumps(document, indent=2, allow_nan=False)
    if path == STANDARD_OUTPUT:
        print(written)
        return
    if path is not None:
        try:
            path.write_text(written + '\n', encoding='utf-8')
        except OSError as error:
            raise BagError(f'--json {path} cannot be written: {error.strerror}') from None
    print(text)


def finite(value: Any) -> Any:
    """Return plain values as JSON takes them: a number that isn't finite becomes None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return value
