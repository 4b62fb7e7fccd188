"""The parameter file of a run: every value of every node, in one place."""

from __future__ import annotations

import dataclasses
import ipaddress
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.node_parameters import NODE_PARAMETERS
from layered_cbf_ros.node_topics import PER_ROBOT, odometry, robot_state
from layered_cbf_ros.parameters import from_mapping, parameters_of, read_parameter_file, values_of
from layered_cbf_ros.run_nodes import (
    COORDINATOR,
    DRIVER,
    RECORDER,
    SIMULATOR,
    STATE_ESTIMATOR,
    node_names,
    plant_of,
)
from layered_cbf_ros.scenario import A1, BASES, EMULATED_A1, ESTIMATOR, HARDWARE, Robot, Scenario
from layered_cbf_ros.scenario_checks import SETTLED, problems
from layered_cbf_ros.timing import REAL_TIME, timing_values
from layered_cbf_ros.yaml_entry import suggestion

Values = dict[str, Any]


def read_defaults(folder: Path) -> dict[str, Values]:
    """Return what `params/<node>.yaml` says, by node.

    Raises:
        ParameterError: If a file has not the form of a ROS parameter file.
    """
    defaults: dict[str, Values] = {}
    for file in sorted(folder.glob('*.yaml')):
        defaults |= read_parameter_file(file)
    return defaults


def with_joystick(scenario: Scenario, folder: Path, pad: str) -> Scenario:
    """Return the scenario with a pad's preset among the coordinator's parameters.

    Args:
        scenario: What is run; what it says itself of the joystick goes behind the preset.
        folder: Where presets are.
        pad: Name of one.

    Raises:
        ParameterError: If there is no such preset.
    """
    names = sorted(file.stem for file in folder.glob('*.yaml'))
    if pad not in names:
        hint = suggestion(pad, names)
        raise ParameterError(f"--joystick: no pad '{pad}'; {hint}there are {', '.join(names)}")
    preset = read_parameter_file(folder / f'{pad}.yaml')[COORDINATOR.strip('/')]
    mine = {**scenario.parameters.get(COORDINATOR.strip('/'), {}), **preset}
    parameters = {**scenario.parameters, COORDINATOR.strip('/'): mine}
    return dataclasses.replace(scenario, parameters=parameters)


def explicit(scenario: Scenario, defaults: Mapping[str, Mapping[str, Any]]) -> Scenario:
    """Return the scenario with every parameter in it that its run will have.

    A bag that holds it can be judged, and the run repeated, whatever becomes of the
    files in params/.

    Args:
        scenario: What is run.
        defaults: Values by node, as `read_defaults` returns them.

    Raises:
        ParameterError: If a default is unknown, out of its range or in contradiction.
    """
    parameters = {}
    for node in NODE_PARAMETERS:
        values = _complete(node, _given(node, scenario, defaults))
        parameters[node] = {name: v for name, v in values.items() if name not in SETTLED}
    whole = dataclasses.replace(scenario, parameters=parameters)
    for problem in problems(whole):
        field = '.'.join(map(str, problem.path))
        raise ParameterError(f'{field} {problem.what}; {problem.remedy}')
    return whole


def run_parameters(
    scenario: Scenario,
    defaults: Mapping[str, Mapping[str, Any]],
    scenario_file: Path,
    bag: Path | None,
    epoch_ns: int = 0,
) -> dict[str, Values]:
    """Return the parameters of every node of a run, by its full name.

    A value of the scenario goes before one of the defaults; what the run itself
    settles (time, scenario, recording) goes before both.

    Args:
        scenario: What is run.
        defaults: Values by node, as `read_defaults` returns them.
        scenario_file: Where the scenario is written for the nodes.
        bag: Folder of the bag, None if nothing is recorded.
        epoch_ns: Wall time at which the time of emulated robots is 0 [ns].

    Raises:
        ParameterError: If a name is unknown or a value out of its range.
    """
    names = node_names(scenario, bag is not None)
    common = {
        **timing_values(scenario),
        'recorded': bag is not None,
        'scenario': str(scenario_file),
        'epoch_ns': epoch_ns if scenario.plant == EMULATED_A1 else 0,
    }
    parameters = {}
    for name in names:
        node = name.rpartition('/')[2]
        parameters[name] = {**_complete(node, _given(node, scenario, defaults)), **common}
    if scenario.plant == BASES:
        parameters[COORDINATOR]['use_sim_time'] = scenario.time == REAL_TIME
    for k, robot in enumerate(() if scenario.plant == BASES else scenario.robots):
        _settle_robot(parameters, scenario, robot, k)
    plant = plant_of(scenario)
    if plant == SIMULATOR:
        parameters[plant]['wait_for'] = [name for name in names if name != plant]
    if bag is not None:
        parameters[RECORDER]['output'] = str(bag)
        last = scenario.robots[-1].name
        if scenario.plant == BASES:  # there is no state of all robots: the last one's counts
            parameters[RECORDER]['state_topic'] = odometry(last)
        elif scenario.plant == A1:
            parameters[RECORDER]['state_topic'] = robot_state(last)
    return parameters


def _settle_robot(
    parameters: dict[str, Values], scenario: Scenario, robot: Robot, number: int
) -> None:
    """Set what follows from the scenario for the nodes of one robot."""
    parameters[f'/{robot.name}/ground_force_mpc']['gait'] = robot.gait
    if scenario.states == ESTIMATOR:
        for node in PER_ROBOT:
            parameters[f'/{robot.name}/{node}']['state_topic'] = robot_state(robot.name)
        start = dict(zip(('start_x', 'start_y'), robot.position, strict=True))
        parameters[f'/{robot.name}/{STATE_ESTIMATOR}'] |= {
            **start,
            'start_yaw': robot.yaw,
            'standing_at_start': scenario.plant not in HARDWARE,
        }
    if scenario.plant not in HARDWARE:
        return
    driver = parameters[f'/{robot.name}/{DRIVER}']
    if scenario.plant == EMULATED_A1:
        emulated = scenario.emulation
        # On this computer nobody can be hurt: nobody needs to be asked.
        here = ipaddress.ip_address(emulated.address).is_loopback
        driver |= {'address': emulated.address, 'port': emulated.port + number}
        driver |= {'local_port': driver['local_port'] + number, 'arm_at_start': here}
    elif robot.address:
        address, _, port = robot.address.rpartition(':')
        driver |= {'address': address, 'port': int(port)}


def parameter_file(parameters: Mapping[str, Values]) -> str:
    """Return the parameters as the text of a ROS parameter file."""
    form = {name: {'ros__parameters': values} for name, values in parameters.items()}
    text: str = yaml.safe_dump(form, sort_keys=False)
    return text


def _given(
    node: str, scenario: Scenario, defaults: Mapping[str, Mapping[str, Any]]
) -> Mapping[str, Any]:
    """Return the values that a scenario or else a file gives a node."""
    return {**defaults.get(node, {}), **scenario.parameters.get(node, {})}


def _complete(node: str, given: Mapping[str, Any]) -> Values:
    """Return every parameter of a node, each in its own type: ROS takes no 1 for 1.0."""
    classes = NODE_PARAMETERS.get(node, ())
    fields = {cls: list(parameters_of(cls)) for cls in classes}
    known = {name for names in fields.values() for name in names}
    for name in given:
        if name not in known:
            raise ParameterError(f"{node}: unknown parameter '{name}'")
    values: Values = {}
    for cls, names in fields.items():
        built: Any = from_mapping(cls, {name: given[name] for name in names if name in given})
        values |= values_of(built)
    return {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}
