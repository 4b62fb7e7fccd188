"""Reachable sets contain what an independent integration of the bodies reaches."""

import numpy as np
import pytest

from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.reachable_sets import agent_reach, obstacle_reach
from layered_cbf_ros.coordination.tracked_bodies import bodies_at
from layered_cbf_ros.interfaces import Track

HORIZON, GAIN, LIMIT, SPEED = 1.0, 2.0, 1.5, 0.5
STEPS = 400


def unit_vectors(rng, count):
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def clipped(vectors, limit):
    size = np.maximum(np.hypot(*vectors.T), limit)
    return vectors * (limit / size)[:, None]


def integrated(law, position, velocity):
    """Integrate phi'' = law(phi, v) by Heun's rule; return all displacements (STEPS, M, 2)."""
    dt, start, path = HORIZON / STEPS, position.copy(), []
    for _ in range(STEPS):
        first = law(position, velocity)
        ahead = position + dt * velocity, velocity + dt * first
        second = law(*ahead)
        position = position + 0.5 * dt * (velocity + ahead[1])
        velocity = velocity + 0.5 * dt * (first + second)
        path.append(position - start)
    return np.array(path)


def farthest(path, direction):
    return np.abs((path * direction).sum(axis=2)).max(axis=0)


def test_reach_of_an_agent_is_what_its_law_does_with_a_held_target():
    """Not only contained but met: 1e-4 m covers the step of the integration."""
    rng = np.random.default_rng(1)
    direction = unit_vectors(rng, 500)
    velocity = rng.uniform(-0.6, 0.6, (500, 2))
    target = clipped(rng.uniform(-0.6, 0.6, (500, 2)), SPEED)
    reach = agent_reach(direction, velocity, target, HORIZON, GAIN, LIMIT)
    path = integrated(
        lambda _, v: clipped(GAIN * (target - v), LIMIT), np.zeros((500, 2)), velocity
    )
    assert np.abs(reach - farthest(path, direction)).max() < 1e-4


def test_reach_contains_the_clipped_law_towards_a_goal():
    """The target fades on the way, so that a path which doesn't turn round is shorter.

    Where it turns round or curves the held target is passed by up to 15 mm in the
    worst of 500 draws: 20 mm is 3 % of two radii. Half the set would miss by 200 mm.
    """
    rng = np.random.default_rng(2)
    direction = unit_vectors(rng, 500)
    velocity = rng.uniform(-0.6, 0.6, (500, 2))
    goal = rng.uniform(-3.0, 3.0, (500, 2))

    def wish(position):
        return clipped(0.5 * (goal - position), SPEED)

    start = np.zeros((500, 2))
    path = integrated(lambda p, v: clipped(GAIN * (wish(p) - v), LIMIT), start, velocity)
    reach = agent_reach(direction, velocity, wish(start), HORIZON, GAIN, LIMIT)
    assert (farthest(path, direction) - reach).max() < 0.02


def test_agent_at_rest_that_wants_nothing_reaches_nothing():
    zero = np.zeros((1, 2))
    reach = agent_reach(np.array([[1.0, 0.0]]), zero, zero, HORIZON, GAIN, LIMIT)
    assert reach[0] == pytest.approx(0.0, abs=1e-9)


def test_reach_of_an_obstacle_contains_every_velocity_within_its_components():
    """Velocities are redrawn at each of 20 steps; the corner of the box is met exactly."""
    rng = np.random.default_rng(3)
    direction, velocity = unit_vectors(rng, 300), rng.uniform(-0.8, 0.8, (300, 2))
    reach = obstacle_reach(direction, velocity, HORIZON)
    share = rng.uniform(-1.0, 1.0, (20, 300, 2))
    path = np.cumsum(share * np.abs(velocity) * HORIZON / 20, axis=0)
    assert (farthest(path, direction) <= reach + 1e-12).all()
    corner = np.sign(direction) * np.abs(velocity) * HORIZON
    assert np.allclose((corner * direction).sum(axis=1), reach, atol=1e-12)


@pytest.mark.parametrize('age', [0.0, 0.02, 0.5])
def test_set_of_an_old_track_contains_an_obstacle_that_turned_unseen(age):
    """It accelerates within its bound while unseen and then keeps its velocity."""
    p = CoordinatorParameters(confidence=0.0)
    rng = np.random.default_rng(4)
    velocity = np.array([-0.3, 0.2])
    track = Track('o', 0, np.zeros(2), velocity, np.zeros((4, 4)), 0.3)
    bodies = bodies_at(round(age * 1e9), [track], p)
    for _ in range(200):
        (n,), (a,) = unit_vectors(rng, 1), p.obstacle_acceleration * unit_vectors(rng, 1)
        unseen = velocity * age + 0.5 * a * age**2
        end = unseen + (velocity + a * age) * p.horizon
        reach = obstacle_reach(n[None], velocity[None], bodies.horizon)[0] + bodies.growth[0]
        assert max(n @ unseen, n @ end) <= reach + 1e-12


def test_what_is_not_known_is_assumed_worse():
    """A set grows with the age and with the covariance, and stops at the age limit."""
    p = CoordinatorParameters()

    def size(age, sigma):
        covariance = sigma**2 * np.eye(4)
        track = Track('o', 0, np.zeros(2), np.array([0.4, 0.0]), covariance, 0.3)
        bodies = bodies_at(round(age * 1e9), [track], p)
        n = np.array([[1.0, 0.0]])
        return (obstacle_reach(n, bodies.velocity, bodies.horizon) + bodies.growth)[0]

    ages = [size(age, 0.01) for age in (0.0, 0.1, 1.0, p.track_age_limit)]
    assert ages == sorted(ages)
    assert ages[0] < ages[1] < ages[2] < ages[3]
    assert size(10.0, 0.01) == ages[3]
    # Two standard deviations of position, and of velocity over one second: 4 * 0.1 m.
    assert size(0.0, 0.1) - size(0.0, 0.0) == pytest.approx(0.4, abs=1e-12)
