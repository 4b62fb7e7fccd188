"""The parts of a scenario file: one function reads one part, strictly."""

from __future__ import annotations

import math
from typing import Any

from layered_cbf_ros.patterns import Circle, Line, Pattern, Standing, Waypoints
from layered_cbf_ros.scenario import (
    BASES,
    BULLET,
    LEGGED,
    OMNI,
    UNICYCLE,
    Desired,
    Detections,
    Obstacle,
    Push,
    Rates,
    Robot,
    VelocityStep,
    Wall,
    World,
)
from layered_cbf_ros.timing import LOCKSTEP, REAL_TIME
from layered_cbf_ros.yaml_entry import Entry

TIMES = (LOCKSTEP, REAL_TIME)
PLANTS = (BULLET, BASES)
KINDS = {BULLET: (LEGGED,), BASES: (OMNI, UNICYCLE)}
GAITS = ('trot', 'stand')
STATE_RATES = {  # whole steps of the simulator's 1 ms
    BULLET: (1000, 500, 250),
    BASES: (1000, 500, 250, 200, 100),
}
DEFAULT_RATES = {BULLET: Rates(), BASES: Rates(100, 100, 100)}
FRAMES = ('body', 'world')
MAX_SEED = 2**32 - 1
PATTERNS: dict[str, type] = {
    'standing': Standing,
    'circle': Circle,
    'line': Line,
    'waypoints': Waypoints,
}


def read_run_settings(entries: dict[str, Entry]) -> dict[str, Any]:
    """Read what belongs to the run as a whole, where it is given."""
    settings: dict[str, Any] = {}
    if 'seed' in entries:
        settings['seed'] = entries['seed'].whole(0, MAX_SEED)
    if 'duration' in entries:
        settings['duration'] = entries['duration'].positive('[s]')
    if 'time' in entries:
        settings['time'] = entries['time'].word(TIMES)
    if 'plant' in entries:
        settings['plant'] = entries['plant'].word(PLANTS)
    if 'goal_tolerance' in entries:
        settings['goal_tolerance'] = entries['goal_tolerance'].positive('[m]')
    return settings


def read_robot(entry: Entry, plant: str) -> Robot:
    """Read one agent of a plant."""
    own = ('payload',) if plant == BULLET else ('radius',)
    entries = entry.mapping(('name', 'position'), ('yaw', 'gait', 'desired', 'kind', *own))
    gait = entries['gait'].word(GAITS) if 'gait' in entries else 'trot'
    desired = _desired(entries['desired']) if 'desired' in entries else Desired()
    if gait == 'stand' and desired != Desired():
        entries['gait'].refuse("say 'trot', or give this robot nothing desired")
    return Robot(
        name=entries['name'].ros_name(),
        position=entries['position'].point(),
        yaw=_number(entries, 'yaw', 0.0, -math.tau, math.tau, '[rad]'),
        gait=gait,
        desired=desired,
        payload=_number(entries, 'payload', 0.0, -4.0, 20.0, '[kg]'),
        kind=entries['kind'].word(KINDS[plant]) if 'kind' in entries else KINDS[plant][0],
        radius=entries['radius'].number(0.05, 2.0, '[m]') if 'radius' in entries else None,
    )


def _desired(entry: Entry) -> Desired:
    kinds = ('goal', 'velocity', *PATTERNS)
    entries = entry.mapping((), (*kinds, 'frame'))
    given = [kind for kind in kinds if kind in entries]
    if len(given) > 1:
        entries[given[1]].refuse('give only one thing desired', f'stands beside {given[0]}')
    if 'frame' in entries and given != ['velocity']:
        entries['frame'].refuse('give it only beside a velocity')
    if not given:
        return Desired()
    if given == ['goal']:
        return Desired(goal=entries['goal'].point())
    if given == ['velocity']:
        frame = entries['frame'].word(FRAMES) if 'frame' in entries else 'body'
        return Desired(velocity=_script(entries['velocity']), frame=frame)
    return Desired(pattern=_pattern(given[0], entries[given[0]]))


def _script(entry: Entry) -> tuple[VelocityStep, ...]:
    steps: list[VelocityStep] = []
    for step in entry.entries():
        entries = step.mapping(('at',), ('x', 'y', 'yaw_rate'))
        at = entries['at'].number(0.0, unit='[s]')
        if steps and at <= steps[-1].at:
            entries['at'].refuse(f'give a time after {steps[-1].at:g} s, that of the step before')
        steps.append(
            VelocityStep(
                at,
                _number(entries, 'x', 0.0, -3.0, 3.0, '[m/s]'),
                _number(entries, 'y', 0.0, -3.0, 3.0, '[m/s]'),
                _number(entries, 'yaw_rate', 0.0, -5.0, 5.0, '[rad/s]'),
            )
        )
    if not steps:
        entry.refuse('give at least one step')
    return tuple(steps)


def _pattern(kind: str, entry: Entry) -> Pattern:
    if kind == 'standing':
        return Standing(entry.mapping(('position',))['position'].point())
    if kind == 'circle':
        entries = entry.mapping(('centre', 'radius', 'speed'), ('phase',))
        return Circle(
            entries['centre'].point(),
            entries['radius'].positive('[m]'),
            entries['speed'].number(unit='[m/s]'),
            _number(entries, 'phase', 0.0, -math.tau, math.tau, '[rad]'),
        )
    if kind == 'line':
        entries = entry.mapping(('start', 'end', 'speed'), ('phase', 'acceleration'))
        start, end = entries['start'].point(), entries['end'].point()
        if start == end:
            entries['end'].refuse('give another point than the start')
        speed = entries['speed'].number(0.0, unit='[m/s]')
        return Line(
            start,
            end,
            speed,
            _number(entries, 'phase', 0.0, 0.0, 1.0, 'of a cycle'),
            _number(entries, 'acceleration', Line.acceleration, 0.01, math.inf, '[m/s^2]'),
        )
    entries = entry.mapping(('points', 'speed'))
    points = tuple(point.point() for point in entries['points'].entries())
    if len(points) < 2:
        entries['points'].refuse('give at least two points')
    return Waypoints(points, entries['speed'].number(0.0, unit='[m/s]'))


def read_obstacle(entry: Entry) -> Obstacle:
    """Read one obstacle."""
    entries = entry.mapping(('name', 'radius', 'motion'), ('height',))
    kind, motion = entries['motion'].one_of(PATTERNS)
    return Obstacle(
        name=entries['name'].ros_name(),
        radius=entries['radius'].positive('[m]'),
        height=entries['height'].positive('[m]') if 'height' in entries else 0.8,
        motion=_pattern(kind, motion),
    )


def read_wall(entry: Entry) -> Wall:
    """Read one wall."""
    entries = entry.mapping(('name', 'point', 'normal'))
    x, y = entries['normal'].numbers(2)
    length = math.hypot(x, y)
    if length == 0.0:
        entries['normal'].refuse('give a direction, towards the allowed side')
    if abs(length - 1.0) > 1e-9:  # a unit vector stays as it is, to the bit
        x, y = x / length, y / length
    return Wall(entries['name'].ros_name(), entries['point'].point(), (x, y))


def read_world(entry: Entry) -> World:
    """Read the world."""
    entries = entry.mapping((), ('friction', 'torque_delay', 'pushes', 'detections'))
    return World(
        friction=_number(entries, 'friction', 0.8, 0.0, 2.0),
        torque_delay=_number(entries, 'torque_delay', 0.0, 0.0, 0.1, '[s]'),
        pushes=tuple(_push(push) for push in list_of(entries, 'pushes')),
        detections=_detections(entries['detections']) if 'detections' in entries else Detections(),
    )


def _push(entry: Entry) -> Push:
    entries = entry.mapping(('robot', 'at', 'duration', 'force'))
    x, y, z = entries['force'].numbers(3, '[N]')
    return Push(
        entries['robot'].text(),
        entries['at'].number(0.0, unit='[s]'),
        entries['duration'].positive('[s]'),
        (x, y, z),
    )


def _detections(entry: Entry) -> Detections:
    entries = entry.mapping((), ('noise', 'delay', 'dropout'))
    return Detections(
        noise=_number(entries, 'noise', 0.0, 0.0, 1.0, '[m]'),
        delay=_number(entries, 'delay', 0.0, 0.0, 1.0, '[s]'),
        dropout=_number(entries, 'dropout', 0.0, 0.0, 1.0),
    )


def read_rates(entry: Entry, plant: str) -> Rates:
    """Read the rates of a plant; each must fit the one above a whole number of times."""
    usual, choices = DEFAULT_RATES[plant], STATE_RATES[plant]
    entries = entry.mapping((), ('state', 'plan', 'detections'))
    state = entries['state'].whole(1, 1000) if 'state' in entries else usual.state
    if state not in choices:
        entries['state'].refuse(f'give one of {", ".join(map(str, choices))} Hz')
    plan = entries['plan'].whole(50, state) if 'plan' in entries else min(state, usual.plan)
    detections = (
        entries['detections'].whole(1, state) if 'detections' in entries else usual.detections
    )
    for name, value in (('plan', plan), ('detections', detections)):
        if state % value and name in entries:
            entries[name].refuse(f'give a divisor of the state rate, {state} Hz')
    if state % detections:
        entry.refuse(f'give detections as a divisor of the state rate, {state} Hz')
    return Rates(state, plan, detections)


def read_parameters(entry: Entry) -> dict[str, dict[str, Any]]:
    """Read the node parameters that the scenario overrides."""
    return {
        node: {name: value.value() for name, value in values.open_mapping().items()}
        for node, values in entry.open_mapping().items()
    }


def _number(
    entries: dict[str, Entry],
    key: str,
    default: float,
    minimum: float,
    maximum: float,
    unit: str = '',
) -> float:
    """Return the number of an optional key."""
    return entries[key].number(minimum, maximum, unit) if key in entries else default


def list_of(entries: dict[str, Entry], key: str) -> list[Entry]:
    """Return the entries of an optional list."""
    return entries[key].entries() if key in entries else []
