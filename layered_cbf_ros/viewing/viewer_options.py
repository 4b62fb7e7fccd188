"""The command line of the viewer."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.bags.command_line import OneLineParser
from layered_cbf_ros.viewing.front.options import FrontOptions, add_front_options

EPILOG = """\
Without RUN the running graph is shown, and may be steered; with RUN its bag, to be scrubbed
through. The page needs no internet. Ctrl-C ends it.
"""


@dataclass(frozen=True, slots=True)
class ViewerOptions:
    """What is asked for.

    Attributes:
        run: The bag to show, None for the running graph.
        front: Where the page is.
        markers: Whether tools that draw get markers and transforms.
    """

    run: Path | None
    front: FrontOptions
    markers: bool


def parse_viewer(arguments: Sequence[str]) -> ViewerOptions:
    """Read the command line, without ROS arguments.

    Raises:
        BagError: If it is wrong.
    """
    parser = OneLineParser('viewer', 'Show a run as a page in the browser.', EPILOG)
    parser.add_argument('run', nargs='?', type=Path, metavar='RUN', help='a run or a bag')
    add_front_options(parser)
    parser.add_argument(
        '--markers',
        action='store_true',
        help='publish /markers and /tf too, for RViz and Foxglove',
    )
    given: argparse.Namespace = parser.parse_args(list(arguments))
    front = FrontOptions(given.host, given.port, given.token)
    return ViewerOptions(given.run, front, given.markers)
