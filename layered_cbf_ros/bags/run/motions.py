"""How the bodies of a run moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.message_form import EFFORT, POSITION, VELOCITY
from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.messages.robot_state import FEET, JOINTS, VELOCITIES, base_names, state_names


@dataclass(frozen=True, slots=True)
class RobotMotion:
    """How one robot moved; every row belongs to one stamp of /state.

    Arrays are views of /state where its order allows it: a minute of four robots is large.

    Attributes:
        stamps_ns: Stamps [ns], (k,).
        configurations: As in RobotState, (k, 19); of a base without legs, its pose, (k, 7).
        rates: Of each entry of a configuration; of the quaternion, three entries hold
            the angular velocity, the fourth is unused, (k, 19) or (k, 7).
        torques: Joint torques [Nm], (k, 12) or (k, 0).
        foot_forces: Normal force on each foot [N], (k, 4) or (k, 0).
    """

    stamps_ns: NDArray[np.int64]
    configurations: Array
    rates: Array
    torques: Array
    foot_forces: Array

    @property
    def velocities(self) -> Array:
        """Velocities as in RobotState, (k, 18) or (k, 6); a copy."""
        return self.rates[:, VELOCITIES[self.rates.shape[1] > VELOCITIES]]

    @property
    def has_legs(self) -> bool:
        """Tell whether this is more than a base."""
        return bool(self.torques.shape[1])


@dataclass(frozen=True, slots=True)
class ObstacleMotion:
    """Where the obstacles truly were, in the scenario's order.

    Attributes:
        stamps_ns: Stamps [ns], (k,).
        positions: Centres in the world plane [m], (k, n, 2).
    """

    stamps_ns: NDArray[np.int64]
    positions: Array


def robot_motions(state: Series | None) -> dict[str, RobotMotion]:
    """Return the motion of each robot that has a base in /state."""
    if state is None:
        return {}
    names = [name.split('/')[0] for name in state.names if name.endswith('/base_x')]
    motions = {}
    for name in names:
        whole = set(state_names(name)) <= set(state.names)
        entries = state_names(name) if whole else base_names(name)
        values = _picked(state.values, state.columns(entries))
        motions[name] = RobotMotion(
            state.stamps_ns,
            values[:, POSITION, : JOINTS.stop],
            values[:, VELOCITY, : JOINTS.stop],
            values[:, EFFORT, JOINTS],
            values[:, EFFORT, FEET],
        )
    return motions


def _picked(values: Array, columns: NDArray[np.intp]) -> Array:
    """Return some columns, as a view if they stand side by side."""
    first = int(columns[0])
    if np.array_equal(columns, first + np.arange(len(columns))):
        return values[:, :, first : first + len(columns)]
    return values[:, :, columns]
