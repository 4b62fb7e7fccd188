"""The motions of a scenario file: what robots want, and how obstacles move."""

from __future__ import annotations

import math

from layered_cbf_ros.patterns import Circle, Line, Pattern, Standing, Waypoints
from layered_cbf_ros.scenario import Desired, VelocityStep
from layered_cbf_ros.yaml_entry import Entry

FRAMES = ('body', 'world')
PATTERNS: dict[str, type] = {
    'standing': Standing,
    'circle': Circle,
    'line': Line,
    'waypoints': Waypoints,
}


def read_desired(entry: Entry) -> Desired:
    """Read what a robot would do if it were alone."""
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
    return Desired(pattern=read_pattern(given[0], entries[given[0]]))


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
                optional_number(entries, 'x', 0.0, -3.0, 3.0, '[m/s]'),
                optional_number(entries, 'y', 0.0, -3.0, 3.0, '[m/s]'),
                optional_number(entries, 'yaw_rate', 0.0, -5.0, 5.0, '[rad/s]'),
            )
        )
    if not steps:
        entry.refuse('give at least one step')
    return tuple(steps)


def read_pattern(kind: str, entry: Entry) -> Pattern:
    """Read a pattern of a kind."""
    if kind == 'standing':
        return Standing(entry.mapping(('position',))['position'].point())
    if kind == 'circle':
        entries = entry.mapping(('centre', 'radius', 'speed'), ('phase',))
        return Circle(
            entries['centre'].point(),
            entries['radius'].positive('[m]'),
            entries['speed'].number(unit='[m/s]'),
            optional_number(entries, 'phase', 0.0, -math.tau, math.tau, '[rad]'),
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
            optional_number(entries, 'phase', 0.0, 0.0, 1.0, 'of a cycle'),
            optional_number(entries, 'acceleration', Line.acceleration, 0.01, math.inf, '[m/s^2]'),
        )
    entries = entry.mapping(('points', 'speed'))
    points = tuple(point.point() for point in entries['points'].entries())
    if len(points) < 2:
        entries['points'].refuse('give at least two points')
    return Waypoints(points, entries['speed'].number(0.0, unit='[m/s]'))


def optional_number(
    entries: dict[str, Entry],
    key: str,
    default: float,
    minimum: float,
    maximum: float,
    unit: str = '',
) -> float:
    """Return the number of an optional key."""
    return entries[key].number(minimum, maximum, unit) if key in entries else default
