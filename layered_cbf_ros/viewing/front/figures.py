"""What a page is told about the run, ten times a second."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.viewing.sight.snapshot import RobotSight, Snapshot

COORDINATOR = '/coordinator'


def figures_of(snapshot: Snapshot | None) -> dict[str, Any]:
    """Return a run's figures for people, ready for JSON.

    Args:
        snapshot: The newest sight of the run, None before the first.
    """
    if snapshot is None:
        return {'time': None, 'robots': [], 'stopped': False, 'paused': False, 'operator': ''}
    told = next((node.values for node in snapshot.nodes if node.name == COORDINATOR), {})
    return {
        'time': snapshot.stamp_ns / NS_PER_S,
        'robots': [_robot(robot, snapshot) for robot in snapshot.robots],
        'stopped': snapshot.is_stopped,
        'paused': snapshot.is_paused,
        'operator': told.get('operator', ''),
    }


def _robot(robot: RobotSight, snapshot: Snapshot) -> dict[str, Any]:
    """Return speed [m/s], smallest h [m] and with whom, and intervention [m/s^2] of a robot."""
    h, other = nearest(robot.name, snapshot)
    return {
        'name': robot.name,
        'speed': _number(float(np.hypot(*robot.velocity))),
        'h': _number(h),
        'other': other,
        'intervention': _number(robot.intervention),
        'held': robot.is_held,
        'steered': robot.is_steered,
    }


def nearest(name: str, snapshot: Snapshot) -> tuple[float, str]:
    """Return the smallest psi0 [m] of a robot's pairs, and who is the other one.

    Without any pair it is infinite, and the other ''.
    """
    found = [(math.inf, '')]
    for barrier in snapshot.barriers:
        first, _, second = barrier.label.partition('~')
        if name in (first, second):
            found.append((barrier.psi0, second if name == first else first))
    return min(found)


def _number(value: float) -> float | None:
    """Return a number as JSON can say it: what isn't finite is null."""
    return round(value, 3) if math.isfinite(value) else None
