"""inspect: tells what is in a bag, in a terminal or as files; works without ROS."""

from __future__ import annotations

from layered_cbf_ros.bags.command_line import run_verb
from layered_cbf_ros.bags.inspection.command_line import main as inspect_bag


def main() -> None:
    """Run the program."""
    run_verb(inspect_bag)
