"""/coordinator/commands: what the coordinator was asked at each tick, as rows of numbers.

Joysticks and planners live in the wall's time. This topic says which of their wishes a tick
used, so that a bag can be judged, and re-solved to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.interfaces import Array, VelocityCommand
from layered_cbf_ros.operation.orders import Orders

FIELDS = ('x', 'y', 'yaw_rate', 'leader')
E_STOP = 'e_stop'


def told_names(robots: Sequence[str]) -> list[str]:
    """Return the names of the values: `<r>/x` ... of every robot, and `e_stop`."""
    return [f'{robot}/{name}' for robot in robots for name in FIELDS] + [E_STOP]


def told(orders: Orders) -> tuple[Array, Array, Array, Array]:
    """Return what is told of a tick, in the order of `told_names`.

    Velocities hold the commands ([m/s], [rad/s], index of the leader, -1 for none);
    effort is 1 where a robot is commanded, and for `e_stop` while it is latched.
    """
    count = len(FIELDS) * len(orders.commands) + 1
    zeros, values, given = np.zeros(count), np.zeros(count), np.zeros(count)
    for k, command in enumerate(orders.commands):
        if command is not None:
            leader = -1.0 if command.leader is None else float(command.leader)
            i = len(FIELDS) * k
            values[i : i + 4] = command.x, command.y, command.yaw_rate, leader
            given[i : i + 4] = 1.0
    given[-1] = float(orders.stopped)
    return zeros, values, zeros, given


def read_told(
    names: Sequence[str], velocities: Array, effort: Array, robots: Sequence[str]
) -> tuple[tuple[VelocityCommand | None, ...], bool]:
    """Return the commands of the robots, and whether the emergency stop is latched.

    Args:
        names, velocities, effort: As `told_names` and `told` give them; a robot that isn't
            among the names isn't commanded.
        robots: Whose commands are wanted.
    """
    places = {name: k for k, name in enumerate(names)}
    commands: list[VelocityCommand | None] = []
    for robot in robots:
        found = [places.get(f'{robot}/{name}') for name in FIELDS]
        if found[0] is None or None in found or effort[found[0]] == 0.0:
            commands.append(None)
            continue
        x, y, yaw_rate, leader = (float(velocities[k]) for k in found if k is not None)
        commands.append(VelocityCommand(x, y, yaw_rate, None if leader < 0.0 else int(leader)))
    return tuple(commands), E_STOP in places and bool(effort[places[E_STOP]])
