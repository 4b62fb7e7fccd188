"""re_solve: what the controllers answer to recorded inputs, now or with other gains."""

from __future__ import annotations

from layered_cbf_ros.bags.command_line import run_verb
from layered_cbf_ros.bags.resolving import command_line


def main() -> None:
    """Run the program."""
    run_verb(command_line.main)
