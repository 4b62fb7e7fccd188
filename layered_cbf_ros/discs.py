"""The discs that robots are kept apart by: how large they are, and where their centres are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from layered_cbf_ros.coordination.fleet_parameters import FleetParameters
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.scenario import UNICYCLE, Scenario


def disc_radii(scenario: Scenario) -> dict[str, float]:
    """Return the radius of each robot's disc [m].

    A scenario that a supervisor runs holds every parameter; one that is run without it
    only what it overrides.
    """
    usual = float(_told(scenario).get('agent_radius', CoordinatorParameters.agent_radius))
    return {robot.name: robot.disc(usual) for robot in scenario.robots}


def disc_offsets(scenario: Scenario) -> dict[str, float]:
    """Return how far the centre of each robot's disc is ahead of where its odometry is [m].

    Zero for all but unicycles: the point on their axle can't go sideways, a point ahead
    of it can go anywhere.
    """
    ahead = float(_told(scenario).get('unicycle_ahead', FleetParameters.unicycle_ahead))
    return {robot.name: ahead if robot.kind == UNICYCLE else 0.0 for robot in scenario.robots}


def shared_frame(scenario: Scenario) -> str:
    """Return the frame in which all bases tell where they are."""
    return str(_told(scenario).get('world_frame', FleetParameters.world_frame))


def _told(scenario: Scenario) -> Mapping[str, Any]:
    return scenario.parameters.get('coordinator', {})
