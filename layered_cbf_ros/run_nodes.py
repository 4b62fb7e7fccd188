"""Which nodes a run consists of: they follow from its scenario."""

from __future__ import annotations

from layered_cbf_ros.node_topics import PER_ROBOT
from layered_cbf_ros.scenario import A1, BASES, EMULATED_A1, ESTIMATOR, HARDWARE, Scenario

SIMULATOR, EMULATOR = '/simulator', '/a1_emulator'
PLANTS = (SIMULATOR, EMULATOR)
FINISHED = 'finished'
"""State of a plant whose scenario is over, and which waits for the others to end."""
RECORDER = '/recorder'
COORDINATOR, TRACKER = '/coordinator', '/obstacle_tracker'
VIEWER = '/viewer'
WHOLE_BODY = 'whole_body_controller'
DRIVER, STATE_ESTIMATOR = 'a1_driver', 'state_estimator'
OF_ONE_ROBOT = (DRIVER, STATE_ESTIMATOR, WHOLE_BODY)
"""Who only its own robot depends on: without it that robot is damped, the others go on."""


def plant_of(scenario: Scenario) -> str | None:
    """Return the node that simulates the world of a scenario; None if the world is real."""
    plants = {A1: None, EMULATED_A1: EMULATOR}
    return plants.get(scenario.plant, SIMULATOR)


def robot_nodes(scenario: Scenario) -> tuple[str, ...]:
    """Return which nodes each robot of a scenario has."""
    if scenario.plant == BASES:
        return ()
    driver = (DRIVER,) if scenario.plant in HARDWARE else ()
    estimator = (STATE_ESTIMATOR,) if scenario.states == ESTIMATOR else ()
    return (*driver, *estimator, *PER_ROBOT)


def node_names(scenario: Scenario, record: bool) -> tuple[str, ...]:
    """Return the full names of all nodes of a run; those that listen come first."""
    names = [RECORDER] if record else []
    names.append(COORDINATOR)
    names += [TRACKER] if scenario.obstacles else []
    nodes, plant = robot_nodes(scenario), plant_of(scenario)
    names += [f'/{robot.name}/{node}' for robot in scenario.robots for node in nodes]
    return (*names, plant) if plant is not None else tuple(names)
