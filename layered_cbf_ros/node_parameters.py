"""Which parameters each node of the graph takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from layered_cbf_ros.bags.recording.parameters import RecorderParameters
from layered_cbf_ros.coordination.fleet_parameters import FleetParameters
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.operation.parameters import JoystickParameters
from layered_cbf_ros.parameters import from_mapping, parameters_of
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.parameters import ObstacleTrackerParameters
from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.emulation.parameters import EmulatorParameters
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.timing import TimingParameters
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters

NODE_PARAMETERS: dict[str, tuple[type, ...]] = {
    'coordinator': (
        CoordinatorParameters,
        FleetParameters,
        JoystickParameters,
        TimingParameters,
    ),
    'ground_force_mpc': (GroundForceParameters, TimingParameters),
    'whole_body_controller': (WholeBodyParameters, TimingParameters),
    'simulator': (SimulatorParameters, TimingParameters),
    'recorder': (RecorderParameters, TimingParameters),
    'state_estimator': (StateEstimatorParameters, TimingParameters),
    'obstacle_tracker': (ObstacleTrackerParameters, TimingParameters),
    'a1_driver': (DriverParameters, TimingParameters),
    'a1_emulator': (EmulatorParameters, TimingParameters),
}


def parameter_names(node: str) -> list[str]:
    """Return the names of all parameters of a node."""
    return [name for cls in NODE_PARAMETERS[node] for name in parameters_of(cls)]


def check_parameters(node: str, values: Mapping[str, Any]) -> None:
    """Check parameter values of a node, by building its dataclasses from them.

    Raises:
        ParameterError: Naming the parameter that is refused.
    """
    for name in values:
        if name not in parameter_names(node):
            raise ParameterError(f"{node}: unknown parameter '{name}'")
    for cls in NODE_PARAMETERS[node]:
        own = parameters_of(cls)
        from_mapping(cls, {name: value for name, value in values.items() if name in own})
