"""The simulated plant against Newton, Coulomb, and a second collision library."""

import dataclasses
import itertools
import math

import coal
import numpy as np
import pinocchio as pin
import pytest

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.patterns import Circle, Line, Standing
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import RobotModel, find_urdf
from layered_cbf_ros.scenario import Obstacle, Push, Robot, Scenario, Wall, World

DT = 1e-3
G = 9.81
PARAMETERS = SimulatorParameters()
MODEL = RobotModel()
TRUNK_CENTRE = np.array([0.012731, 0.002186, 0.000515])  # of mass, as the URDF has it [m]


def scenario(robots=1, **changes):
    if isinstance(robots, int):
        robots = tuple(Robot(f'a1_{i}', (0.0, 0.0)) for i in range(robots))
    plain = Scenario(
        name='test',
        description='',
        seed=0,
        duration=1.0,
        time='lockstep',
        plant='bullet',
        goal_tolerance=0.1,
        robots=robots,
    )
    return dataclasses.replace(plain, **changes)


def pose(x=0.0, y=0.0, yaw=0.0, up=0.0):
    configuration = MODEL.nominal_configuration(np.array([x, y]), yaw)
    configuration[2] += up
    return configuration


@pytest.fixture
def build():
    """Build worlds that are closed after the test."""
    worlds = []

    def _build(description, *starts, parameters=PARAMETERS):
        worlds.append(BulletWorld(description, parameters, starts))
        return worlds[-1]

    yield _build
    for world in worlds:
        world.close()


def hold(world, starts, steps):
    """Let springs and dampers hold the joints; return the first robot's foot forces, summed."""
    wanted = np.array(starts)[:, 7:]
    carried = []
    for _ in range(steps):
        states = world.states()
        q = np.array([state.configuration[7:] for state in states])
        v = np.array([state.velocity[6:] for state in states])
        world.step(150.0 * (wanted - q) - 3.0 * v)
        carried.append(world.states()[0].foot_forces.sum())
    return np.array(carried)


def drift(world, steps, robots=1):
    for _ in range(steps):
        world.step(np.zeros((robots, 12)))


def com(state):
    MODEL.update_kinematics(state.configuration, state.velocity)
    return MODEL.com.copy(), MODEL.com_velocity.copy()


def feet(state):
    MODEL.update_kinematics(state.configuration, state.velocity)
    return MODEL.feet.copy()


def test_a_dropped_robot_falls_by_half_g_t_squared(build):
    world = build(scenario(), pose(up=2.0))
    drift(world, 400)
    state = world.states()[0]
    t = 0.4
    fallen = pose(up=2.0)[2] - state.configuration[2]
    assert world.stamp_ns == state.stamp_ns == 400_000_000
    assert fallen == pytest.approx(0.5 * G * t * t, abs=G * t * DT)  # Euler's O(dt)
    assert state.velocity[2] == pytest.approx(-G * t, abs=1e-6)
    np.testing.assert_allclose(world.imu(0).specific_force, 0.0, atol=1e-6)


def test_the_start_is_the_configuration_asked_for(build):
    """Bullet's base pose is the inertial frame's; an unconverted one errs by 9-12 mm."""
    start = pose(1.0, -2.0, yaw=2.0, up=0.5)
    state = build(scenario(), start).states()[0]
    np.testing.assert_allclose(state.configuration, start, atol=1e-12)
    np.testing.assert_array_equal(state.velocity, 0.0)


def test_the_velocity_is_the_rate_of_the_configuration_in_the_base_frame(build):
    """A tumbling robot: pinocchio's difference of two configurations is the oracle."""
    push = Push('a1_0', 0.0, 0.02, (100.0, -200.0, 50.0))
    world = build(scenario(world=World(pushes=(push,))), pose(yaw=1.0, up=3.0))
    model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
    torques = np.tile([2.0, -1.0, 1.0, -2.0, 1.0, 0.5], 2)[None, :]
    for _ in range(60):
        world.step(torques)
    before = world.states()[0].configuration
    world.step(torques)
    state = world.states()[0]
    rate = pin.difference(model, before, state.configuration) / DT
    assert np.linalg.norm(state.velocity[3:6]) > 1.0
    # Bullet integrates at the CoM: the origin's velocity turns by w dt within the step.
    np.testing.assert_allclose(rate, state.velocity, atol=0.01)


@pytest.mark.parametrize('payload', [0.0, 3.0, -1.0])
def test_the_feet_carry_the_weight(build, payload):
    start = pose()
    world = build(scenario(robots=(Robot('a1_0', (0.0, 0.0), payload=payload),)), start)
    hold(world, [start], 800)
    forces = hold(world, [start], 200)
    imu = world.imu(0)
    weight = (MODEL.mass + payload) * G
    assert np.mean(forces) == pytest.approx(weight, rel=5e-3)  # the springs still swing
    assert np.linalg.norm(imu.specific_force) == pytest.approx(G, abs=0.1)
    assert imu.specific_force[2] > 9.7


@pytest.mark.parametrize('payload', [0.0, 3.0])
def test_a_payload_is_a_point_mass_at_the_trunks_centre(build, payload):
    """Accelerations of the first step against pinocchio's forward dynamics."""
    robot = Robot('a1_0', (0.0, 0.0), payload=payload)
    start = pose(yaw=0.5, up=2.0)
    world = build(scenario(robots=(robot,)), start)
    torques = np.random.default_rng(0).normal(0.0, 3.0, 12)
    world.step(torques[None, :])
    model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
    model.inertias[1] += pin.Inertia(payload, TRUNK_CENTRE, np.zeros((3, 3)))
    forces = np.append(np.zeros(6), torques)
    expected = pin.aba(model, model.createData(), start, np.zeros(18), forces)
    found = world.states()[0].velocity / DT
    # The base frame has turned by w dt^2 meanwhile: a part in 10^4 of the velocity.
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_a_push_gives_the_momentum_force_times_time(build):
    force = np.array([30.0, -50.0, 20.0])
    push = Push('a1_0', 0.01, 0.1, tuple(force))
    world = build(scenario(world=World(pushes=(push,))), pose(yaw=0.7, up=3.0))
    drift(world, 10)
    _, before = com(world.states()[0])
    drift(world, 150)
    _, after = com(world.states()[0])
    gained = MODEL.mass * (after - before + np.array([0.0, 0.0, G * 0.15]))
    # 0.2 %: Bullet's integrator lets a turning tree's momentum wander a little.
    np.testing.assert_allclose(gained, force * 0.1, atol=2e-3 * np.linalg.norm(force * 0.1))


@pytest.mark.parametrize('friction', [0.2, 0.4])
def test_feet_that_slide_are_held_back_by_coulombs_share_of_the_weight(build, friction):
    """Friction is what is missing in the momentum; the push lasts the whole time."""
    start = pose()
    for share, slides in ((0.4, False), (1.5, True)):
        force = share * friction * MODEL.mass * G
        world = build(
            scenario(
                world=World(friction=friction, pushes=(Push('a1_0', 0.3, 0.3, (force, 0, 0)),))
            ),
            start,
        )
        hold(world, [start], 450)
        (_, before), toes = com(world.states()[0]), feet(world.states()[0])
        normal = hold(world, [start], 150)
        (_, after), moved = com(world.states()[0]), (feet(world.states()[0]) - toes)[:, 0]
        held = force * 0.15 - MODEL.mass * (after[0] - before[0])
        used = held / (np.sum(normal) * DT)
        if slides:
            assert moved.min() > 0.005
            assert used == pytest.approx(friction, rel=0.03)  # feet also creep sideways
        else:
            assert np.abs(moved).max() < 0.002
            assert used < 0.8 * friction


def test_torques_act_after_their_delay_and_within_their_limit(build):
    world = build(scenario(world=World(torque_delay=0.003)), pose(up=2.0))
    acted = []
    for _ in range(5):
        world.step(np.full((1, 12), 50.0))
        acted.append(world.states()[0].torques[0])
    assert acted == [0.0, 0.0, 0.0, PARAMETERS.torque_limit, PARAMETERS.torque_limit]
    assert world.states()[0].velocity[6] > 0.0


def test_a_torque_that_is_not_finite_is_refused_before_it_does_harm(build):
    world = build(scenario(robots=2), pose(), pose(y=2.0))
    torques = np.zeros((2, 12))
    torques[1, 3] = math.nan
    with pytest.raises(MessageError, match='a1_1'):
        world.step(torques)
    assert world.stamp_ns == 0


def test_a_damped_robot_comes_to_rest_whatever_it_is_told(build):
    world = build(scenario(robots=2), pose(up=3.0), pose(y=3.0, up=3.0))
    for _ in range(20):
        world.step(np.full((2, 12), 1.0))
    moving = [np.abs(state.velocity[6:]).max() for state in world.states()]
    for _ in range(100):
        world.damp(1)
        world.step(np.full((2, 12), 1.0))
    free, damped = (np.abs(state.velocity[6:]).max() for state in world.states())
    assert moving[1] > 2.0
    assert damped < 0.1 * moving[1] < free


def test_two_worlds_told_the_same_go_through_the_same_states(build):
    """Bit for bit, contacts with everything included; a third world runs in between."""
    obstacle = Obstacle('obstacle_1', 0.3, 0.8, Circle((0.9, 0.0), 0.3, 0.5))
    wall = Wall('wall_left', (0.0, 1.0), (0.0, -1.0))
    what = scenario(robots=2, obstacles=(obstacle,), walls=(wall,))
    starts = [pose(), pose(y=0.65)]
    histories = []
    for _ in range(2):
        world, other = build(what, *starts), build(what, *starts)
        random = np.random.default_rng(3)
        history = []
        for _ in range(400):
            world.step(random.normal(0.0, 10.0, (2, 12)))
            other.step(random.normal(0.0, 10.0, (2, 12)))
            for state in world.states():
                history += [state.configuration, state.velocity, state.foot_forces]
        report = world.clearances()
        histories.append(b''.join(x.tobytes() for x in (*history, report.distances, report.forces)))
    assert histories[0] == histories[1]


def coal_shapes(configuration):
    """Return the robot's collision shapes, placed by pinocchio."""
    model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
    geometry = pin.buildGeomFromUrdf(model, str(find_urdf()), pin.GeometryType.COLLISION)
    data, places = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, places, configuration)
    return [(it.geometry, places.oMg[k]) for k, it in enumerate(geometry.geometryObjects)]


def coal_distance(ours, theirs):
    """Return the smallest distance between two lists of placed shapes."""
    best = math.inf
    for (a, place_a), (b, place_b) in itertools.product(ours, theirs):
        placed = [
            coal.Transform3s(place.rotation, place.translation) for place in (place_a, place_b)
        ]
        result = coal.DistanceResult()
        best = min(best, coal.distance(a, placed[0], b, placed[1], coal.DistanceRequest(), result))
    return best


def moved_world(build, seed):
    """A world whose bodies are fast and in odd poses: what is a step old is wrong."""
    random = np.random.default_rng(seed)
    obstacle = Obstacle(
        'obstacle_1', 0.3, 12.0, Line((0.9, -3.0), (0.9, 3.0), 4.0, 0.125, math.inf)
    )
    standing = Obstacle('obstacle_2', 0.2, 12.0, Standing((40.0, 0.0)))
    direction = random.uniform(0.0, math.tau)
    normal = (math.cos(direction), math.sin(direction))
    wall = Wall('wall', (-0.8 * normal[0], -0.8 * normal[1]), normal)
    pushes = tuple(Push(f'a1_{i}', 0.0, 0.05, tuple(random.normal(0.0, 60.0, 3))) for i in range(2))
    what = scenario(2, obstacles=(obstacle, standing), walls=(wall,), world=World(pushes=pushes))
    starts = [pose(yaw=random.uniform(0, 6), up=1.0), pose(0.2, 0.9, random.uniform(0, 6), 1.0)]
    world = build(what, *starts)
    for _ in range(150):
        world.step(random.normal(0.0, 4.0, (2, 12)))
    return world, what


@pytest.mark.parametrize('seed', range(4))
def test_clearances_agree_with_another_collision_library(build, seed):
    """Within 1 mm, the radius with which Bullet rounds the edges of its shapes."""
    world, what = moved_world(build, seed)
    report = world.clearances()
    found = dict(zip(report.labels, report.distances, strict=True))
    robots = [coal_shapes(state.configuration) for state in world.states()]
    assert report.stamp_ns == world.stamp_ns
    expected = {'a1_0~a1_1': coal_distance(*robots)}
    for i, shapes in enumerate(robots):
        for k, obstacle in enumerate(what.obstacles):
            place = pin.SE3(np.eye(3), np.append(world.obstacle_positions()[k], 6.0))
            cylinder = [(coal.Cylinder(obstacle.radius, obstacle.height), place)]
            expected[f'a1_{i}~{obstacle.name}'] = coal_distance(shapes, cylinder)
        (wall,) = what.walls
        normal = np.append(wall.normal, 0.0)
        expected[f'a1_{i}~wall'] = min(
            normal @ place.translation - reach(shape, place.rotation.T @ normal)
            for shape, place in shapes
        ) - np.dot(wall.normal, wall.point)
    for label, distance in expected.items():
        if distance < PARAMETERS.exact_within:
            assert found[label] == pytest.approx(distance, abs=1e-3), label
        else:
            assert PARAMETERS.exact_within <= found[label] <= distance + 1e-3, label
    assert sum(distance < PARAMETERS.exact_within for distance in expected.values()) >= 2


def reach(shape, direction):
    """Return how far a shape extends from its centre along a direction (its own frame)."""
    if isinstance(shape, coal.Box):
        return np.abs(direction) @ shape.halfSide
    if isinstance(shape, coal.Sphere):
        return shape.radius
    return shape.radius * math.hypot(*direction[:2]) + shape.halfLength * abs(direction[2])


def test_standing_robots_touch_nothing_but_ground_with_their_toes(build):
    starts = [pose(), pose(y=1.0)]
    wall = Wall('wall_right', (0.0, -1.0), (0.0, 1.0))
    world = build(scenario(robots=2, walls=(wall,)), *starts)
    hold(world, starts, 200)
    np.testing.assert_array_equal(world.clearances().forces, 0.0)


def test_a_robot_pushed_against_a_wall_touches_it(build):
    wall = Wall('wall_left', (0.0, 0.4), (0.0, -1.0))
    push = Push('a1_0', 0.0, 0.3, (0.0, 120.0, 0.0))
    world = build(scenario(walls=(wall,), world=World(pushes=(push,))), pose())
    hold(world, [pose()], 300)
    report = world.clearances()
    assert report.forces[report.labels.index('a1_0~wall_left')] > 1.0
    assert world.clearances().forces.max() == 0.0  # a peak is told once


def test_an_obstacle_pushes_a_robot_along_without_entering_it(build):
    """It has a velocity, not just one position after the other: else it is 12 mm inside."""
    roller = Obstacle('obstacle_1', 0.3, 0.8, Line((1.0, 0.0), (-1.0, 0.0), 1.0, 0.0, math.inf))
    world = build(scenario(obstacles=(roller,)), pose())
    reports = []
    for _ in range(70):
        hold(world, [pose()], 10)
        reports.append(world.clearances())
    pair = reports[0].labels.index('a1_0~obstacle_1')
    assert max(report.forces[pair] for report in reports) > 10.0
    assert min(report.distances[pair] for report in reports) > -0.001
    position, velocity = com(world.states()[0])
    assert position[0] < -0.1
    assert velocity[0] == pytest.approx(-1.0, abs=0.1)


def test_a_robot_on_its_belly_touches_the_ground(build):
    world = build(scenario(), pose())
    drift(world, 600)
    report = world.clearances()
    ground = report.labels.index('a1_0~ground')
    assert report.forces[ground] > 0.5 * MODEL.mass * G
    assert report.distances[ground] == pytest.approx(0.0, abs=0.05)


def test_obstacles_are_where_their_patterns_have_them(build):
    motions = (Circle((1.0, 2.0), 0.5, 0.4, 0.3), Line((3.0, 0.0), (5.0, 1.0), 0.4))
    things = tuple(Obstacle(f'obstacle_{k}', 0.3, 0.8, m) for k, m in enumerate(motions))
    world = build(scenario(obstacles=things), pose())
    drift(world, 250)
    np.testing.assert_array_equal(world.obstacle_positions(), [m.at(0.25)[0] for m in motions])
