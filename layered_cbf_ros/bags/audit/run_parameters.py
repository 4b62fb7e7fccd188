"""What a run was told: the values in its recorded scenario that the audit needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.scenario import BASES, Scenario
from layered_cbf_ros.timing import TimingParameters, timing_values


@dataclass(frozen=True, slots=True)
class RunParameters:
    """Parameters of the nodes of one run.

    Attributes:
        alpha1, wall_alpha1: Decay rate from psi0 to psi1, of pairs and of walls [1/s].
        gain: Velocity gain of the known law, beta_2 [1/s].
        horizon: Of the reachable sets [s].
        radii: Of the disc around each robot [m].
        speed_limit, acceleration_limit: Of the plan, per axis [m/s], [m/s^2].
        yaw_rate_limit: Of the plan [rad/s].
        confidence: Standard deviations that widen a track's set.
        obstacle_acceleration: What an unseen obstacle may do [m/s^2].
        track_age_limit: Age after which a track's set stops growing [s].
        longest_gap: Missed time over which the plan coasts at most [s].
        max_obstacles: Tracks heeded at once.
        friction: Coefficient of the planned forces.
        max_normal_force: Of a foot [N].
        torque_limit: Of the commands [Nm].
        command_age, plan_age, forces_age: Oldest that may act in real time [s].
        base_margin: How much smaller than its disc a base's body is [m].
    """

    alpha1: float
    wall_alpha1: float
    gain: float
    horizon: float
    radii: Mapping[str, float]
    speed_limit: float
    acceleration_limit: float
    yaw_rate_limit: float
    confidence: float
    obstacle_acceleration: float
    track_age_limit: float
    longest_gap: float
    max_obstacles: int
    friction: float
    max_normal_force: float
    torque_limit: float
    command_age: float
    plan_age: float
    forces_age: float
    base_margin: float


def parameters_of(scenario: Scenario) -> RunParameters:
    """Return the parameters that a scenario tells.

    Raises:
        BagError: If it lacks one, as when no supervisor ran it.
    """
    coordinator = _Node(scenario, 'coordinator')
    mpc, wbc = _Node(scenario, 'ground_force_mpc'), _Node(scenario, 'whole_body_controller')
    simulator, radius = _Node(scenario, 'simulator'), coordinator.number('agent_radius')
    has_legs = scenario.plant != BASES
    return RunParameters(
        alpha1=coordinator.number('alpha1'),
        wall_alpha1=coordinator.number('wall_alpha1'),
        gain=coordinator.number('beta', 1),
        horizon=coordinator.number('horizon'),
        radii={robot.name: robot.disc(radius) for robot in scenario.robots},
        speed_limit=coordinator.number('speed_limit'),
        acceleration_limit=coordinator.number('acceleration_limit'),
        yaw_rate_limit=coordinator.number('yaw_rate_limit'),
        confidence=coordinator.number('confidence'),
        obstacle_acceleration=coordinator.number('obstacle_acceleration'),
        track_age_limit=coordinator.number('track_age_limit'),
        longest_gap=coordinator.number('longest_gap'),
        max_obstacles=int(coordinator.number('max_obstacles')),
        friction=mpc.number('friction'),
        max_normal_force=mpc.number('max_normal_force'),
        torque_limit=wbc.number('torque_limit'),
        command_age=simulator.number('command_age_limit' if has_legs else 'base_timeout'),
        plan_age=min(wbc.number('age_limit'), mpc.number('age_limit')),
        forces_age=wbc.number('age_limit'),
        base_margin=0.0 if has_legs else simulator.number('base_margin'),
    )


def timing_of(scenario: Scenario) -> TimingParameters:
    """Return the rates of a scenario, from which the input rules follow."""
    return TimingParameters(**timing_values(scenario))


class _Node:
    """The recorded parameters of one node."""

    def __init__(self, scenario: Scenario, node: str) -> None:
        self._node = node
        self._values: Mapping[str, Any] = scenario.parameters.get(node, {})

    def number(self, name: str, place: int | None = None) -> float:
        """Return a number, or one of a list.

        Raises:
            BagError: If it is absent or no number.
        """
        value = self._values.get(name)
        if place is not None and isinstance(value, (list, tuple)) and len(value) > place:
            value = value[place]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BagError(
                f'/scenario: parameters.{self._node}.{name} is {value}; only a run of the '
                'supervisor records every parameter'
            )
        return float(value)
