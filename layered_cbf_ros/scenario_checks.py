"""What a scenario may not ask for, though each of its values is well formed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.node_parameters import NODE_PARAMETERS, check_parameters, parameter_names
from layered_cbf_ros.patterns import Standing
from layered_cbf_ros.scenario import (
    BASES,
    EMULATED_A1,
    HARDWARE,
    Obstacle,
    Robot,
    Scenario,
    Wall,
    World,
)
from layered_cbf_ros.scenario_operator import STEERED
from layered_cbf_ros.timing import REAL_TIME
from layered_cbf_ros.yaml_entry import suggestion

BODY_RADIUS = 0.3  # a disc of this radius contains a standing A1 [m]
RESERVED = ('ground',)
RATES = 'give rates: instead'
SETTLED = {
    'time': 'give time: instead',
    'state_rate': RATES,
    'plan_rate': RATES,
    'detection_rate': RATES,
    'detection_delay': 'give the delay of world: detections: instead',
    'pace': 'give pace: instead',
    'epoch_ns': 'leave it out: it is when the run begins',
    'gait': "give the robot's gait instead",
    **dict.fromkeys(
        ('output', 'topics', 'regex', 'exclude_topics', 'exclude_regex', 'force'),
        'leave it out: a run records all topics into its own folder',
    ),
}
"""Node parameters that follow from the rest of a scenario, and what to give instead."""
SHARED = ('com_height', 'braking')
SHARING = ('ground_force_mpc', 'whole_body_controller')

Point = tuple[float, float]


@dataclass(frozen=True)
class Problem:
    """Something impossible.

    Attributes:
        path: Keys and indices of the field in the file.
        what: What is wrong, continuing "<field> ...".
        remedy: What to do about it.
    """

    path: tuple[str | int, ...]
    what: str
    remedy: str


def problems(scenario: Scenario) -> Iterator[Problem]:
    """Find everything that is impossible, in the order in which to tell it."""
    yield from _names(scenario)
    yield from _starts(scenario)
    yield from _goals(scenario)
    yield from _pushes(scenario)
    yield from _legless(scenario)
    yield from _steered(scenario)
    yield from _wired(scenario)
    yield from _overrides(scenario)
    yield from _disagreements(scenario)


def _names(scenario: Scenario) -> Iterator[Problem]:
    seen: dict[str, str] = dict.fromkeys(RESERVED, 'a word of this package')
    groups: dict[str, tuple[Robot | Obstacle | Wall, ...]] = {
        'robots': scenario.robots,
        'obstacles': scenario.obstacles,
        'walls': scenario.walls,
    }
    for group, members in groups.items():
        for k, member in enumerate(members):
            if member.name in seen:
                what = f"is '{member.name}', which is also {seen[member.name]}"
                yield Problem((group, k, 'name'), what, 'give each thing a name of its own')
            seen[member.name] = f'{group}[{k}]'


def _starts(scenario: Scenario) -> Iterator[Problem]:
    for i, robot in enumerate(scenario.robots):
        path, where, size = ('robots', i, 'position'), f"puts '{robot.name}' ", _disc(robot)
        for wall in scenario.walls:
            room = _room(robot.position, wall)
            if room < size:
                what = f"{where}{room:.2f} m from wall '{wall.name}'"
                yield Problem(path, what, f'leave {size:g} m')
        for obstacle in scenario.obstacles:
            gap = math.dist(robot.position, obstacle.motion.at(0.0)[0]) - obstacle.radius
            if gap < size:
                what = f"{where}{gap:.2f} m from the surface of '{obstacle.name}' at the start"
                yield Problem(path, what, f'leave {size:g} m')
        for other in scenario.robots[:i]:
            apart, least = math.dist(robot.position, other.position), size + _disc(other)
            if apart < least:
                what = f"{where}{apart:.2f} m from '{other.name}'"
                yield Problem(path, what, f'leave {least:g} m between centres')


def _goals(scenario: Scenario) -> Iterator[Problem]:
    for i, robot in enumerate(scenario.robots):
        goal, size = robot.desired.goal, _disc(robot)
        if goal is None:
            continue
        path = ('robots', i, 'desired', 'goal')
        for wall in scenario.walls:
            if _room(goal, wall) < size:
                what = f"lies {_room(goal, wall):.2f} m from wall '{wall.name}'"
                yield Problem(path, what, f'leave {size:g} m')
        for obstacle in scenario.obstacles:
            if not isinstance(obstacle.motion, Standing):
                continue
            gap = math.dist(goal, obstacle.motion.position) - obstacle.radius
            if gap < size:
                what = f"lies {gap:.2f} m from the surface of '{obstacle.name}', which stands there"
                yield Problem(path, what, f'leave {size:g} m')


def _pushes(scenario: Scenario) -> Iterator[Problem]:
    names = [robot.name for robot in scenario.robots]
    for k, push in enumerate(scenario.world.pushes):
        path = ('world', 'pushes', k, 'robot')
        if push.robot not in names:
            remedy = f'{suggestion(push.robot, names)}the robots are {", ".join(names)}'
            yield Problem(path, f"is '{push.robot}', which isn't there", remedy)


def _legless(scenario: Scenario) -> Iterator[Problem]:
    """Find what only acts on legs, in a world without them."""
    if scenario.plant != BASES:
        return
    for field in ('friction', 'torque_delay', 'pushes'):
        if getattr(scenario.world, field) != getattr(World(), field):
            remedy = f'leave {field} out: bases follow velocities, not forces'
            yield Problem(('world', field), f'means nothing to plant: {BASES}', remedy)


def _steered(scenario: Scenario) -> Iterator[Problem]:
    names = [robot.name for robot in scenario.robots]
    known = (*names, *STEERED)
    for k, step in enumerate(scenario.operator):
        if step.steer and step.steer not in known:
            remedy = f'{suggestion(step.steer, known)}steer one of {", ".join(known)}'
            yield Problem(('operator', k, 'steer'), f"is '{step.steer}', which isn't there", remedy)


def _wired(scenario: Scenario) -> Iterator[Problem]:
    """Find what can't be of robots at the other end of a wire, or only of them."""
    if scenario.plant in HARDWARE and scenario.time != REAL_TIME:
        yield Problem(('time',), f'is {scenario.time}', f'say {REAL_TIME}: robots wait for nobody')
    if scenario.plant != EMULATED_A1 and scenario.pace != 1.0 and scenario.plant not in HARDWARE:
        yield Problem(('pace',), f'is {scenario.pace:g}', f'leave it out, or plant: {EMULATED_A1}')
    names = [robot.name for robot in scenario.robots]
    for k, press in enumerate(scenario.emulation.remote):
        if press.robot not in names:
            remedy = f'{suggestion(press.robot, names)}the robots are {", ".join(names)}'
            path = ('emulation', 'remote', k, 'robot')
            yield Problem(path, f"is '{press.robot}', which isn't there", remedy)


def _overrides(scenario: Scenario) -> Iterator[Problem]:
    for node, values in scenario.parameters.items():
        if node not in NODE_PARAMETERS:
            remedy = f'{suggestion(node, NODE_PARAMETERS)}known are {", ".join(NODE_PARAMETERS)}'
            yield Problem(('parameters', node), 'is an unknown node', remedy)
            continue
        known = parameter_names(node)
        for name in values:
            if name not in known:
                remedy = f'{suggestion(name, known)}known here are {", ".join(known)}'
                yield Problem(('parameters', node, name), 'is an unknown parameter', remedy)
                return
            if name in SETTLED:
                what = 'follows from the rest of the scenario'
                yield Problem(('parameters', node, name), what, SETTLED[name])
        try:
            check_parameters(node, values)
        except ParameterError as error:
            name = next((name for name in values if f'.{name} ' in str(error)), '')
            yield Problem(('parameters', node, name), f'is refused: {error}', 'mend the value')


def _disagreements(scenario: Scenario) -> Iterator[Problem]:
    """Find what the two controllers of a robot must agree on and don't."""
    mine, theirs = (scenario.parameters.get(node, {}) for node in SHARING)
    for name in SHARED:
        if mine.get(name) != theirs.get(name):
            node = SHARING[name not in mine]
            what = f'differs between {" and ".join(SHARING)}'
            yield Problem(('parameters', node, name), what, 'give both the same')


def _disc(robot: Robot) -> float:
    """Return the radius of a robot's disc, as far as the scenario tells it [m]."""
    return robot.disc(BODY_RADIUS)


def _room(point: Point, wall: Wall) -> float:
    """Return the distance of a point from a wall, negative inside [m]."""
    (x, y), (px, py), (nx, ny) = point, wall.point, wall.normal
    return (x - px) * nx + (y - py) * ny
