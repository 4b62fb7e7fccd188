"""Scenario files: YAML to Scenario and back; every refusal says what to do.

A scenario travels as JSON in the same form as the file, so that one strict reader
serves both.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from layered_cbf_ros.errors import ScenarioError
from layered_cbf_ros.patterns import Pattern
from layered_cbf_ros.resources import find_folder
from layered_cbf_ros.scenario import HARDWARE, LEGGED, Desired, Scenario, World
from layered_cbf_ros.scenario_checks import problems
from layered_cbf_ros.scenario_emulation import Emulation, read_emulation
from layered_cbf_ros.scenario_motion import PATTERNS
from layered_cbf_ros.scenario_operator import pad_step_form, read_operator
from layered_cbf_ros.scenario_parts import (
    DEFAULT_RATES,
    PLANTS,
    STATES,
    list_of,
    read_obstacle,
    read_parameters,
    read_rates,
    read_robot,
    read_run_settings,
    read_wall,
    read_world,
)
from layered_cbf_ros.timing import LOCKSTEP, REAL_TIME
from layered_cbf_ros.yaml_entry import read_document, suggestion


def load_scenario(path_or_name: str | Path) -> Scenario:
    """Read a scenario file.

    Args:
        path_or_name: Path of a YAML file, or the name of one in params/scenarios.

    Raises:
        ScenarioError: If there is no such file, or it is misspelt or impossible.
    """
    path = _find(path_or_name)
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: can't be read: {error}; give a YAML file") from None
    return _parse(text, path.name, path.stem)


def from_json(text: str) -> Scenario:
    """Build a scenario from what `to_json` returned.

    Raises:
        ScenarioError: If the text is misspelt or describes an impossible world.
    """
    return _parse(text, 'scenario', '')


def to_json(scenario: Scenario) -> str:
    """Return the scenario as JSON, in the form of a scenario file."""
    form: dict[str, Any] = asdict(scenario)
    for robot, entry in zip(scenario.robots, form['robots'], strict=True):
        entry['desired'] = _desired_form(robot.desired)
        if robot.kind != LEGGED:
            del entry['payload']
        if robot.radius is None:
            del entry['radius']
        if scenario.plant not in HARDWARE:
            del entry['address']
    for obstacle, entry in zip(scenario.obstacles, form['obstacles'], strict=True):
        entry['motion'] = _pattern_form(obstacle.motion)
    form['operator'] = [pad_step_form(step) for step in scenario.operator]
    return json.dumps(form, ensure_ascii=False)


def with_overrides(
    scenario: Scenario,
    seed: int | None = None,
    duration: float | None = None,
    time: str | None = None,
) -> Scenario:
    """Return the scenario with another seed, duration [s] or time mode, where given.

    Raises:
        ScenarioError: If one is out of its range.
    """
    given = {'seed': seed, 'duration': duration, 'time': time}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    entries = read_document(json.dumps(changes), 'command line').mapping((), given)
    return replace(scenario, **read_run_settings(entries))


def _find(path_or_name: str | Path) -> Path:
    path = Path(path_or_name)
    if path.suffix in ('.yaml', '.yml') or path.parent != Path():
        if path.is_file():
            return path
        raise ScenarioError(f'{path}: no such file; give a path or the name of a scenario')
    folder = find_folder('params') / 'scenarios'
    names = sorted(file.stem for file in folder.glob('*.yaml'))
    if path.name not in names:
        hint = suggestion(path.name, names)
        raise ScenarioError(f"no scenario '{path}'; {hint}there are {', '.join(names)}")
    return folder / f'{path.name}.yaml'


def _parse(text: str, source: str, name: str) -> Scenario:
    root = read_document(text, source)
    entries = root.mapping(
        ('description', 'duration', 'robots'),
        (
            *('name', 'seed', 'time', 'plant', 'states', 'pace', 'goal_tolerance', 'emulation'),
            *('obstacles', 'walls', 'world', 'rates', 'parameters', 'operator'),
        ),
    )
    settings: dict[str, Any] = {
        'seed': 0,
        'plant': PLANTS[0],
        'goal_tolerance': 0.2,
        **read_run_settings(entries),
    }
    plant = settings['plant']
    settings.setdefault('time', REAL_TIME if plant in HARDWARE else LOCKSTEP)
    states = entries['states'].word(STATES[plant]) if 'states' in entries else STATES[plant][0]
    scenario = Scenario(
        name=entries['name'].text() if 'name' in entries else name,
        description=entries['description'].text(),
        robots=tuple(read_robot(entry, plant) for entry in entries['robots'].entries()),
        obstacles=tuple(read_obstacle(entry) for entry in list_of(entries, 'obstacles')),
        walls=tuple(read_wall(entry) for entry in list_of(entries, 'walls')),
        world=read_world(entries['world']) if 'world' in entries else World(),
        rates=(read_rates(entries['rates'], plant) if 'rates' in entries else DEFAULT_RATES[plant]),
        parameters=read_parameters(entries['parameters']) if 'parameters' in entries else {},
        operator=read_operator(list_of(entries, 'operator')),
        states=states,
        emulation=(read_emulation(entries['emulation']) if 'emulation' in entries else Emulation()),
        **settings,
    )
    if not scenario.robots:
        entries['robots'].refuse('give at least one robot')
    for problem in problems(scenario):
        root.at(*problem.path).refuse(problem.remedy, problem.what)
    return scenario


def _pattern_form(pattern: Pattern) -> dict[str, Any]:
    (kind,) = [kind for kind, cls in PATTERNS.items() if type(pattern) is cls]
    return {kind: asdict(pattern)}  # type: ignore[call-overload]


def _desired_form(desired: Desired) -> dict[str, Any]:
    if desired.goal is not None:
        return {'goal': desired.goal}
    if desired.pattern is not None:
        return _pattern_form(desired.pattern)
    if desired.velocity:
        return {'velocity': [asdict(step) for step in desired.velocity], 'frame': desired.frame}
    return {}
