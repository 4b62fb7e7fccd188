"""The audit's own geometry and its second derivation of the barriers, by other means."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from layered_cbf_ros.bags.audit import reach
from layered_cbf_ros.bags.audit.body_geometry import BodyGeometry
from layered_cbf_ros.bags.audit.clearance import distances, exact_distance
from layered_cbf_ros.bags.audit.findings import NOT_PROVEN, Samples, at_least, at_most
from layered_cbf_ros.bags.audit.lens import barrier, enclosed_barrier
from layered_cbf_ros.bags.audit.surfaces import Cylinder, HalfSpace, RobotBody
from layered_cbf_ros.coordination.collision_ball import collision_balls
from layered_cbf_ros.coordination.reachable_sets import agent_reach, unseen_growth
from layered_cbf_ros.patterns import Standing
from layered_cbf_ros.robot_model import find_urdf
from layered_cbf_ros.scenario import Obstacle, Wall

AUDIT = Path(reach.__file__).parent
PACKAGE = 'layered_cbf_ros'
FORBIDDEN = (
    f'{PACKAGE}.coordination',
    f'{PACKAGE}.bags.run.verdict',
    f'{PACKAGE}.bags.run.measures',
    f'{PACKAGE}.bags.run.checks',
    f'{PACKAGE}.bags.run.distances',
    f'{PACKAGE}.bags.run.evidence',
    f'{PACKAGE}.bags.run.run_record',
)
RANGES = f'{PACKAGE}.coordination.parameters', f'{PACKAGE}.coordination.fleet_parameters'
LAW = 1.0, 2.0, 1.5  # horizon [s], gain [1/s], limit [m/s^2]


@pytest.fixture(scope='module')
def geometry():
    return BodyGeometry()


def imported(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
    return found


def reached(path: Path, seen: set[Path]) -> set[str]:
    """Return all modules of the package that a file imports, whatever is in between."""
    seen.add(path)
    names = {name for name in imported(path) if name.startswith(PACKAGE)}
    for name in list(names):
        file = AUDIT.parents[2] / f'{name.replace(".", "/")}.py'
        if file.is_file() and file not in seen:
            names |= reached(file, seen)
    return names


@pytest.mark.parametrize('path', sorted(AUDIT.glob('*.py')), ids=lambda path: path.name)
def test_the_audit_shares_no_arithmetic_with_what_it_audits(path):
    """Neither by itself nor through what it imports: there only ranges of parameters."""
    assert not [name for name in imported(path) if name.startswith(FORBIDDEN)]
    through = {name for name in reached(path, set()) if name.startswith(FORBIDDEN)}
    assert not {name for name in through if not name.startswith(RANGES)}


def configurations(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.0, 1.0, (count, 19))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    q[:, 7:] = np.tile([0.0, 0.9, -1.8], 4) + 0.3 * q[:, 7:]
    return q


def test_frames_and_centre_of_mass_are_pinocchio_s(geometry):
    """Any base and joints, against the library's own recursion."""
    model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
    data, qs = model.createData(), configurations(50)
    rotations, origins = geometry.frames(qs)
    com = geometry.centres_of_mass(qs)
    for k, q in enumerate(qs):
        assert com[k] == pytest.approx(pin.centerOfMass(model, data, q), abs=1e-12)
        for j in range(1, model.njoints):
            assert np.allclose(rotations[k, j], data.oMi[j].rotation, atol=1e-12)
            assert np.allclose(origins[k, j], data.oMi[j].translation, atol=1e-12)


def test_spheres_cover_every_corner_of_the_robot(geometry):
    """Points of every shape's surface, drawn at random, lie in some sphere."""
    rng, (q,) = np.random.default_rng(1), configurations(1, seed=5)
    (centres,), radii = geometry.cover_centres(q[None]), geometry.cover.radius
    for shape, pose in zip(geometry.shapes, geometry.placements(q), strict=True):
        points = rng.uniform(-1.0, 1.0, (400, 3))
        if isinstance(shape, coal.Box):
            points = np.sign(points) * np.array(shape.halfSide)  # its corners
        elif isinstance(shape, coal.Cylinder):
            points[:, :2] *= shape.radius / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
            points[:, 2] = np.sign(points[:, 2]) * shape.halfLength
        else:
            points *= shape.radius / np.linalg.norm(points, axis=1, keepdims=True)
        world = points @ pose.getRotation().T + pose.getTranslation()
        outside = np.linalg.norm(world[:, None] - centres, axis=2) - radii
        assert outside.min(axis=1).max() < 1e-9


def others(k: int, geometry: BodyGeometry) -> dict:
    """A robot that walks by, a pillar, a wall; k samples."""
    passing = np.tile(configurations(1, seed=3), (k, 1))
    passing[:, 3:7] = 0.0, 0.0, 0.0, 1.0
    passing[:, 0], passing[:, 1:3] = np.linspace(-2.0, 2.0, k), (0.65, 0.3)
    pillar = Obstacle('pillar', 0.2, 0.8, Standing((0.0, 0.0)))
    centres = np.column_stack((np.linspace(-1.5, 1.5, k), np.full(k, -0.35)))
    return {
        'robot': RobotBody(geometry, passing, np.full(k, 1.0)),
        'pillar': Cylinder(pillar, centres),
        'wall': HalfSpace(Wall('wall', (0.0, -0.4), (0.0, 1.0))),
    }


@pytest.mark.parametrize('kind', ['robot', 'pillar', 'wall'])
def test_branch_and_bound_finds_what_asking_everywhere_finds(geometry, kind):
    """The smallest distance, every one below zero, and never a bound above the truth."""
    k = 300
    q = np.tile(np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0, *[0.0, 0.9, -1.8] * 4]), (k, 1))
    q[:, 1] += 0.05 * np.sin(np.linspace(0.0, 9.0, k))
    body, other = RobotBody(geometry, q, np.full(k, 0.8)), others(k, geometry)[kind]
    found = distances(body, other, 0.0)
    exact = np.array([exact_distance(body, other, row) for row in range(k)])
    assert found.min() == pytest.approx(exact.min(), abs=1e-9)
    assert (found <= exact + 1e-9).all()
    assert np.allclose(found[exact <= 0.0], exact[exact <= 0.0], atol=1e-9)
    assert kind != 'pillar' or (exact < 0.0).any()


def test_distance_from_a_wall_is_that_of_its_lowest_corner(geometry):
    """Plain geometry: the trunk's box, turned, and a wall that only it can reach."""
    shape, half = geometry.shapes[0], np.array(geometry.shapes[0].halfSide)
    turned = pin.rpy.rpyToMatrix(0.3, 0.2, 0.7)
    quaternion = pin.Quaternion(turned).coeffs()
    q = np.array([1.0, 2.0, 5.0, *quaternion, *[0.0, 0.9, -1.8] * 4])
    corner = np.abs(turned[1]) @ half
    wall = HalfSpace(Wall('wall', (7.0, 2.0 - corner - 0.4), (0.0, 1.0)))
    pose = geometry.placements(q)[0]
    (solid,) = wall.solids(0)
    found = coal.distance(shape, pose, solid.shape, solid.pose, coal.DistanceRequest(),
                          coal.DistanceResult())  # fmt: skip
    assert found == pytest.approx(0.4, abs=1e-9)


def test_reach_by_stepping_agrees_with_the_closed_form():
    """Two derivations of the same law; the accuracy is the one that the audit allows for."""
    rng, k = np.random.default_rng(0), 20_000
    velocity, target = rng.uniform(-0.6, 0.6, (2, k, 1, 2))
    angle = rng.uniform(0.0, math.tau, k)
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    stepped = reach.agent_reaches(velocity, target, np.array([0]), direction[:, None], LAW)[:, 0]
    closed = agent_reach(direction, velocity[:, 0], target[:, 0], *LAW)
    assert np.abs(stepped - closed).max() < reach.ACCURACY / 4


@pytest.mark.parametrize(('v', 'target', 'expected'), [(0.5, 0.5, 0.5), (0.0, 0.0, 0.0)])
def test_who_has_what_he_wants_goes_straight_on(v, target, expected):
    velocity, wish = np.array([[[v, 0.0]]]), np.array([[[target, 0.0]]])
    for direction in ((1.0, 0.0), (-1.0, 0.0)):
        ahead = reach.agent_reaches(velocity, wish, np.array([0]), np.array([[direction]]), LAW)
        assert ahead[0, 0] == pytest.approx(expected, abs=1e-12)


def test_a_box_of_velocities_reaches_its_farthest_corner():
    velocity, direction = np.array([-0.3, 0.4]), np.array([0.6, 0.8])
    assert reach.box_reach(velocity, direction, 2.0) == pytest.approx(2.0 * (0.18 + 0.32))


def test_an_old_and_uncertain_track_is_wider():
    covariance = np.array([[4e-4, 1e-4, 1e-4, 0.01, -0.002, 0.03]])
    full = np.array(
        [[4e-4, 1e-4, 0, 0], [1e-4, 1e-4, 0, 0], [0, 0, 0.01, -0.002], [0, 0, -0.002, 0.03]]
    )
    for age in (0.0, 0.01, 0.5):
        wider = reach.track_growth(covariance, np.array([age]), (1.0, 0.3, 2.0))
        assert wider[0] == pytest.approx(unseen_growth(age, 1.0, 0.3, full, 2.0), abs=1e-12)


def test_the_lens_is_where_both_discs_are():
    """Its smallest circle, found by trying, is the one that the barrier is made of."""
    d, i, j = 1.0, 0.8, 0.6
    x, y = np.meshgrid(np.linspace(-1.0, 2.0, 1201), np.linspace(-1.0, 1.0, 801))
    both = (np.hypot(x, y) <= i) & (np.hypot(x - d, y) <= j)
    points = np.column_stack((x[both], y[both]))
    centres = np.linspace(0.4, 1.0, 601)
    radii = [np.hypot(points[:, 0] - centre, points[:, 1]).max() for centre in centres]
    best = int(np.argmin(radii))
    assert barrier(*np.array([d, i, j])) == pytest.approx(centres[best] - radii[best], abs=5e-3)


def test_both_ways_to_the_barrier_agree_in_every_case():
    rng, k = np.random.default_rng(0), 50_000
    distance, own, ball = rng.uniform(0.3, 4.0, k), rng.uniform(0, 2, k), rng.uniform(0.3, 2.5, k)
    places, ahead = np.zeros((k, 2)), np.tile([1.0, 0.0], (k, 1))
    other = collision_balls(places, ahead, distance, own, ball).barrier
    assert np.abs(barrier(distance, own, ball) - other).max() < 1e-9
    low, high = enclosed_barrier(distance, own, ball, 1e-5)
    assert (low <= other + 1e-9).all()
    assert (other <= high + 1e-9).all()
    assert np.median(high - low) < 1e-4


def test_a_limit_may_be_reached_but_a_surface_not_touched():
    times, values = np.arange(4.0), np.array([1.0, 2.0, 2.0, 3.0])
    assert len(at_most('x', 'm', [Samples('a', times, values, 2.0)]).breaches) == 1
    assert len(at_least('x', 'm', [Samples('a', times, values, 1.0)]).breaches) == 0
    touch = at_least('x', 'm', [Samples('a', times, values, 1.0)], relation='>')
    (breach,) = touch.breaches
    assert (breach.start_s, breach.value) == (0.0, 1.0)


def test_values_that_are_not_finite_are_never_fine():
    for value in (math.nan, math.inf, -math.inf):
        check = at_most('x', 'm', [Samples('a', np.arange(2.0), np.array([0.0, value]), 1.0)])
        assert (check.status, len(check.holes)) == (NOT_PROVEN, 1)
