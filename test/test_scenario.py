"""Scenario files: what is said is read, and what can't be is refused in one clear line."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from layered_cbf_ros import resources
from layered_cbf_ros import scenario as scenario_module
from layered_cbf_ros.errors import LayeredCbfError, ScenarioError
from layered_cbf_ros.patterns import Circle, Line, Standing, Waypoints
from layered_cbf_ros.scenario import Push, VelocityStep
from layered_cbf_ros.scenario_file import from_json, load_scenario, to_json, with_overrides

PARAMS = Path(__file__).resolve().parents[1] / 'params'
SHIPPED = sorted(path.stem for path in (PARAMS / 'scenarios').glob('*.yaml'))

GOOD = """\
description: Two robots, an obstacle and a wall.
seed: 3
duration: 20.0
time: lockstep
robots:
  - name: a1_0
    position: [0.0, 0.0]
    gait: trot
    desired: {goal: [5.0, 0.0]}
  - name: a1_1
    position: [0.0, 2.0]
obstacles:
  - name: obstacle_1
    radius: 0.3
    motion: {standing: {position: [3.0, 2.0]}}
walls:
  - {name: wall_left, point: [0.0, 4.0], normal: [0.0, -1.0]}
world:
  pushes:
    - {robot: a1_0, at: 1.0, duration: 0.1, force: [0.0, 40.0, 0.0]}
parameters:
  simulator: {torque_limit: 30.0}
"""


@pytest.fixture
def refusal(tmp_path):
    """Return the text of the error that a scenario text causes."""

    def _refusal(text):
        path = tmp_path / 'mine.yaml'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        with pytest.raises(ScenarioError) as caught:
            load_scenario(path)
        assert '\n' not in str(caught.value)
        return str(caught.value)

    return _refusal


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_scenarios_load_and_survive_json(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert from_json(to_json(scenario)) == scenario
    assert json.loads(to_json(scenario))['description'] == scenario.description


def test_numbers_survive_json_to_the_bit():
    scenario = dataclasses.replace(
        load_scenario('four_agents'), duration=1e-7, goal_tolerance=0.1 + 0.2
    )
    half = math.sqrt(0.5)
    wall = dataclasses.replace(scenario.walls[0], point=(-99.0, -99.0), normal=(half, half))
    scenario = dataclasses.replace(scenario, walls=(wall,), robots=scenario.robots[:1])
    assert from_json(to_json(scenario)) == scenario


def test_the_template_names_every_field():
    """A field that is added to a scenario must be explained there."""
    text = (PARAMS / 'scenarios' / 'template.yaml').read_text()
    told = [cls for cls in vars(scenario_module).values() if dataclasses.is_dataclass(cls)]
    told += [Circle, Line, Standing, Waypoints]
    names = {field.name for cls in told for field in dataclasses.fields(cls)}
    names -= {'name', 'pattern'}  # the file's own name; a pattern goes by its kind
    assert {name for name in names if f'{name}:' not in text} == set()


def test_the_template_is_read_as_it_is_meant():
    template = load_scenario('template')
    assert [type(thing.motion) for thing in template.obstacles] == [
        Circle,
        Line,
        Waypoints,
        Standing,
    ]
    assert template.robots[0].desired.goal == (3.0, 0.0)
    assert template.robots[1].desired.pattern == Circle((0.0, 1.0), 1.0, 0.3, 1.5708)
    assert template.robots[2].desired.velocity[1] == VelocityStep(6.0, 0.2, 0.1, 0.3)
    assert template.world.pushes == (Push('a1_0', 5.0, 0.1, (0.0, 40.0, 0.0)),)
    assert template.world.detections.dropout == 0.05
    assert template.parameters['simulator'] == {'torque_limit': 30.0}


@pytest.mark.parametrize('name', ['four_agents', 'template'])
def test_robots_that_follow_a_pattern_start_on_it(name):
    for robot in load_scenario(name).robots:
        if robot.desired.pattern is not None:
            start, _ = robot.desired.pattern.at(0.0)
            np.testing.assert_allclose(start, robot.position, atol=1e-4)


def test_the_example_of_the_readme_is_a_scenario(tmp_path):
    text = (Path(__file__).parents[1] / 'README.md').read_text()
    example = text.partition('```yaml\n')[2].partition('```')[0]
    path = tmp_path / 'my_world.yaml'
    path.write_text(example)
    assert [robot.name for robot in load_scenario(path).robots] == ['a1_0', 'a1_1']


def test_a_wall_normal_of_any_length_is_made_a_unit_vector(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(GOOD.replace('normal: [0.0, -1.0]', 'normal: [3.0, -4.0]'))
    assert load_scenario(path).walls[0].normal == pytest.approx((0.6, -0.8))


# What is changed in the good file; the line, and words of the refusal.
MISTAKES = [
    ('seed: 3', 'sed: 3', 2, "sed is an unknown key; did you mean 'seed'?"),
    ('seed: 3', 'seed: -3', 2, "seed is '-3'; keep it in [0,"),
    ('seed: 3', 'seed: 3.5', 2, 'give a whole number'),
    ('seed: 3', 'seed: 3\nseed: 4', 3, 'seed is given twice'),
    ('duration: 20.0\n', '', 1, 'duration is missing'),
    ('duration: 20.0', 'duration: 0', 3, 'above 0 [s]'),
    ('duration: 20.0', 'duration: .inf', 3, 'duration is'),
    ('duration: 20.0', 'duration: nan', 3, 'finite'),
    ('duration: 20.0', 'duration: 1:30', 3, 'give a number'),
    ('duration: 20.0', 'duration: true', 3, 'give a number'),
    ('duration: 20.0', 'duration: "20"', 3, 'give a number'),
    ('duration: 20.0', 'duration:', 3, 'is empty; give a number'),
    ('time: lockstep', 'time: lock_step', 4, "did you mean 'lockstep'?"),
    ('time: lockstep', 'plant: gazebo', 4, 'choose one of bullet'),
    ('time: lockstep', 'rates: {state: 300}', 4, 'give one of 1000, 500, 250 Hz'),
    ('time: lockstep', 'rates: {plan: 300}', 4, 'a divisor of the state rate, 1000 Hz'),
    ('time: lockstep', 'rates: {stats: 500}', 4, "did you mean 'state'?"),
    ('gait: trot', 'gait: gallop', 8, "robots[0].gait is 'gallop'; choose one of trot, stand"),
    ('gait: trot', 'gait: stand', 8, 'gait'),
    ('gait: trot', 'payload: -9', 8, 'keep it in [-4, 20] [kg]'),
    (
        'position: [0.0, 0.0]',
        'position: [0.0]',
        7,
        'robots[0].position is a list of 1; give a list of 2',
    ),
    ('position: [0.0, 0.0]', 'position: [0.0, x]', 7, "robots[0].position[1] is 'x'"),
    ('position: [0.0, 0.0]', 'positon: [0.0, 0.0]', 7, "did you mean 'position'?"),
    ('position: [0.0, 0.0]', 'position: [0.0, 1.5]', 11, "0.50 m from 'a1_0'; leave 0.6 m"),
    ('position: [0.0, 0.0]', 'position: [0.0, 4.5]', 7, "-0.50 m from wall 'wall_left'"),
    ('position: [0.0, 0.0]', 'position: [2.6, 2.0]', 7, "0.10 m from the surface of 'obstacle_1'"),
    ('goal: [5.0, 0.0]', 'goal: [5.0, 3.9]', 9, 'robots[0].desired.goal lies 0.10 m from wall'),
    ('goal: [5.0, 0.0]', 'goal: [3.0, 2.2]', 9, "obstacle_1', which stands there"),
    ('goal: [5.0, 0.0]', 'gaol: [5.0, 0.0]', 9, "did you mean 'goal'?"),
    ('goal: [5.0, 0.0]', 'goal: [5.0, 0.0], frame: body', 9, 'only beside a velocity'),
    ('goal: [5.0, 0.0]', 'goal: [5.0, 0.0], velocity: []', 9, 'only one thing'),
    ('goal: [5.0, 0.0]', 'velocity: []', 9, 'at least one step'),
    ('goal: [5.0, 0.0]', 'velocity: [{at: 1}, {at: 1}]', 9, 'velocity[1].at'),
    ('name: a1_1', 'name: a1_0', 10, "robots[1].name is 'a1_0', which is also robots[0]"),
    ('name: a1_1', 'name: ground', 10, 'a name of its own'),
    ('name: a1_1', 'name: a1-1', 10, 'use letters, digits'),
    ('name: a1_1', 'name: 1a', 10, 'use letters, digits'),
    ('name: a1_1', 'name: a__1', 10, 'use letters, digits'),
    ('name: obstacle_1', 'name: wall_left', 17, "walls[0].name is 'wall_left', which is also obs"),
    ('radius: 0.3', 'radius: -0.3', 14, 'obstacles[0].radius is'),
    ('radius: 0.3', 'radius: 0.3\n    height: 0', 15, 'obstacles[0].height is'),
    ('{standing: {position: [3.0, 2.0]}}', '{}', 15, 'give exactly one of standing, circle'),
    ('standing: {position: [3.0, 2.0]}', 'circel: {}', 15, "did you mean 'circle'?"),
    (
        'standing: {position: [3.0, 2.0]}',
        'circle: {centre: [3, 2], radius: 0, speed: 1}',
        15,
        'obstacles[0].motion.circle.radius',
    ),
    (
        'standing: {position: [3.0, 2.0]}',
        'line: {start: [3, 2], end: [4, 2], speed: -1}',
        15,
        "speed is '-1'; keep it in [0, inf]",
    ),
    (
        'standing: {position: [3.0, 2.0]}',
        'line: {start: [3, 2], end: [3, 2], speed: 1}',
        15,
        'another point',
    ),
    (
        'standing: {position: [3.0, 2.0]}',
        'waypoints: {points: [[3, 2]], speed: 1}',
        15,
        'at least two points',
    ),
    ('normal: [0.0, -1.0]', 'normal: [0.0, 0.0]', 17, 'towards the allowed side'),
    ('robot: a1_0', 'robot: a1_2', 20, "did you mean 'a1_1'?"),
    ('force: [0.0, 40.0, 0.0]', 'force: 40.0', 20, 'give a list of 3 numbers [N]'),
    ('simulator:', 'simulatr:', 22, "did you mean 'simulator'?"),
    ('torque_limit: 30.0', 'torque_limt: 30.0', 22, "did you mean 'torque_limit'?"),
    ('torque_limit: 30.0', 'torque_limit: 3000.0', 22, 'keep it in [0.1, 100] Nm'),
    ('torque_limit: 30.0', 'torque_limit: high', 22, 'give a number'),
    ('{torque_limit: 30.0}', '3', 22, 'give a mapping'),
    ('torque_limit: 30.0', 'time: real_time', 22, 'give time: instead'),
    ('torque_limit: 30.0', 'state_rate: 500', 22, 'give rates: instead'),
    ('torque_limit: 30.0', 'detection_delay: 0.1', 22, 'give the delay of world: detections:'),
    ('simulator: {torque_limit: 30.0}', 'coordinator: {rate: 500}', 22, 'parameters.coordinator.r'),
    (
        'simulator: {torque_limit: 30.0}',
        'ground_force_mpc: {gait: stand}',
        22,
        "give the robot's gait instead",
    ),
    (
        'simulator: {torque_limit: 30.0}',
        'ground_force_mpc: {com_height: 0.25}',
        22,
        'ground_force_mpc.com_height differs',
    ),
    (
        'simulator: {torque_limit: 30.0}',
        'whole_body_controller: {braking: 2.0}',
        22,
        'whole_body_controller.braking differs',
    ),
    (
        'simulator: {torque_limit: 30.0}',
        '{ground_force_mpc: {braking: 2.0}, whole_body_controller: {braking: 3.0}}',
        22,
        'give both the same',
    ),
    ('seed: 3', 'seed: [3', 3, 'not YAML'),
    ('seed: 3', '\tseed: 3', 2, 'not YAML'),
]


@pytest.mark.parametrize(('right', 'wrong', 'line', 'words'), MISTAKES)
def test_a_mistake_is_named_with_its_line_and_a_remedy(refusal, right, wrong, line, words):
    assert right in GOOD
    text = refusal(GOOD.replace(right, wrong, 1))
    assert text.startswith(f'mine.yaml:{line}: ')
    assert words in text


FLEET = """\
description: Two bases.
duration: 20.0
plant: bases
robots:
  - name: base_0
    kind: unicycle
    position: [0.0, 0.0]
    radius: 0.4
  - {name: base_1, position: [0.0, 2.0]}
world: {detections: {noise: 0.01}}
"""


@pytest.mark.parametrize(
    ('right', 'wrong', 'line', 'words'),
    [
        ('kind: unicycle', 'kind: legged', 6, "kind is 'legged'; choose one of omni, unicycle"),
        ('radius: 0.4', 'radius: 0', 8, "radius is '0'; keep it in [0.05, 2] [m]"),
        ('radius: 0.4', 'payload: 1.0', 8, 'payload is an unknown key'),
        ('radius: 0.4', 'radius: 1.9', 9, "2.00 m from 'base_0'; leave 2.2 m"),
        ('plant: bases\n', '', 7, 'radius is an unknown key'),
        ('world: {', 'world: {torque_delay: 0.01, ', 10, 'means nothing to plant: bases'),
        ('world: {', 'rates: {state: 50}\nworld: {', 10, 'give one of 1000, 500, 250, 200, 100'),
    ],
)
def test_a_mistake_in_a_fleet_is_named_with_its_line_and_a_remedy(
    refusal, right, wrong, line, words
):
    assert right in FLEET
    text = refusal(FLEET.replace(right, wrong, 1))
    assert text.startswith(f'mine.yaml:{line}: ')
    assert words in text


def test_a_fleet_has_its_own_rates_and_discs(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(FLEET)
    scenario = load_scenario(path)
    assert (scenario.rates.state, scenario.rates.plan, scenario.rates.detections) == (100,) * 3
    assert [robot.kind for robot in scenario.robots] == ['unicycle', 'omni']
    assert [robot.disc(0.3) for robot in scenario.robots] == [0.4, 0.3]
    assert from_json(to_json(scenario)) == dataclasses.replace(scenario)
    assert {robot.kind for robot in load_scenario('four_agents').robots} == {'legged'}


def test_the_file_without_the_mistakes_is_accepted(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(GOOD)
    assert load_scenario(str(path)).robots[1].name == 'a1_1'


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'empty'),
        ('# nothing\n', 'empty'),
        ('- 1\n', 'give a mapping'),
        ('description: x\nduration: 1\nrobots: []\n', 'at least one robot'),
        ('description: x\nduration: 1\nrobots:\n', 'robots is empty; give a list'),
        ('a: b: c', 'not YAML'),
        (b'\xff\xfe\xfa', "can't be read"),
        (b'a: \x01', 'not YAML'),
        ('[' * 5000, 'not YAML'),
        ('&a [*a]', 'give a mapping'),
        ('? [1]\n: 2\n', 'plain words as keys'),
    ],
)
def test_what_is_no_scenario_at_all_is_refused(refusal, text, words):
    assert words in refusal(text)


def test_a_missing_file_or_name_is_told_with_the_nearest_name(tmp_path):
    with pytest.raises(ScenarioError, match=r"did you mean 'four_agents'\?"):
        load_scenario('four_agent')
    for path in (tmp_path / 'none.yaml', tmp_path):
        with pytest.raises(ScenarioError, match='no such file'):
            load_scenario(path)


def test_overrides_are_checked_as_the_file_is():
    scenario = load_scenario('stand')
    changed = with_overrides(scenario, seed=7, duration=3, time='real_time')
    assert (changed.seed, changed.duration, changed.time) == (7, 3.0, 'real_time')
    assert changed.robots == scenario.robots
    assert with_overrides(scenario) == scenario
    for wrong in ({'seed': -1}, {'seed': 1.5}, {'duration': math.nan}, {'time': 'now'}):
        with pytest.raises(ScenarioError, match=f'^command line:1: {next(iter(wrong))} is'):
            with_overrides(scenario, **wrong)


def test_data_folders_are_found_installed_first(tmp_path, monkeypatch):
    installed = tmp_path / 'overlay' / 'share' / 'layered_cbf_ros' / 'params'
    installed.mkdir(parents=True)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path / "nothing"}:{tmp_path / "overlay"}')
    assert resources.find_folder('params') == installed
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')
    monkeypatch.setattr(resources.sys, 'prefix', str(tmp_path))
    assert resources.find_folder('params') == PARAMS
    with pytest.raises(LayeredCbfError, match='no folder'):
        resources.find_folder('nonsense')
