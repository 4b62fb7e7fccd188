"""audit: recomputes from a bag whether its run kept its promises; works without ROS."""

from __future__ import annotations

from layered_cbf_ros.bags.audit.command_line import main as audit_bag
from layered_cbf_ros.bags.command_line import run_verb


def main() -> None:
    """Run the program."""
    run_verb(audit_bag)
