"""How an A1 lies before anybody stands it up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.plants.bullet_world import STEP_NS, BulletWorld
from layered_cbf_ros.plants.emulation.motors import joint_torques
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.scenario import Robot, Scenario

FOLDED = np.tile([0.0, 1.3, -2.6], 4)
"""Joint angles from which it sinks to the ground [rad], (12,)."""
ABOVE = 0.13
"""Height of its base at first: the toes just reach the ground [m]."""
SETTLED_S = 2.0


def lying_configuration() -> Array:
    """Return the configuration of a robot that has sunk to the ground, its motors off.

    At the origin, heading along x, (19,); found by letting one sink.
    """
    robot = Robot('sinking', (0.0, 0.0))
    scenario = Scenario('', '', 0, SETTLED_S, 'lockstep', 'bullet', 0.1, (robot,))
    start = np.concatenate(((0.0, 0.0, ABOVE, 0.0, 0.0, 0.0, 1.0), FOLDED))
    world = BulletWorld(scenario, SimulatorParameters(exact_within=0.0), [start])
    try:
        for _ in range(round(SETTLED_S * 1e9) // STEP_NS):
            (state,) = world.states()
            world.step(joint_torques(None, state.configuration[7:], state.velocity[6:])[None])
        return world.states()[0].configuration
    finally:
        world.close()


def placed(configuration: Array, position: Sequence[float], yaw: float) -> Array:
    """Return a configuration turned about the vertical, its base at a place.

    Args:
        configuration: At the origin, heading about along x, (19,).
        position: Of the base in the plane [m], (2,).
        yaw: Turn [rad].
    """
    moved = configuration.copy()
    moved[:2] = position
    x, y, z, w = configuration[3:7].tolist()
    s, c = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    moved[3:7] = c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z
    return moved
