"""A run on several computers: which of its nodes each of them starts.

Each robot's own computer runs the nodes of that robot, a base station all others.
"""

from __future__ import annotations

from collections.abc import Sequence

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.scenario import HARDWARE, Scenario
from layered_cbf_ros.yaml_entry import suggestion

ALL, BASE = 'all', 'base'


def check_host(scenario: Scenario, host: str) -> None:
    """Make sure that a computer has a share of a run.

    Args:
        scenario: What is run.
        host: ALL, BASE or the name of a robot.

    Raises:
        LayeredCbfError: If it has none, or the run can't be shared out.
    """
    known = (ALL, BASE, *(robot.name for robot in scenario.robots))
    if host not in known:
        hint = suggestion(host, known)
        raise LayeredCbfError(f"--host: no host '{host}'; {hint}there are {', '.join(known)}")
    if host != ALL and scenario.plant not in HARDWARE:
        raise LayeredCbfError(
            f'--host {host}: plant: {scenario.plant} runs on one computer; leave --host out'
        )


def share_of(names: Sequence[str], host: str) -> tuple[str, ...]:
    """Return the nodes that a computer starts.

    Args:
        names: Full names of all nodes of the run.
        host: ALL, BASE or the name of a robot.
    """
    if host == ALL:
        return tuple(names)
    owners = [name.strip('/').rpartition('/')[0] or BASE for name in names]
    return tuple(name for name, owner in zip(names, owners, strict=True) if owner == host)
