"""The collision ball encloses the lens, and its barrier keeps the promised distance."""

import numpy as np
import pytest

from layered_cbf_ros.coordination.collision_ball import collision_balls


def random_pairs(count=4000):
    rng = np.random.default_rng(5)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    position = rng.uniform(-5.0, 5.0, (count, 2))
    distance, reach, ball = (rng.uniform(low, 2.0, count) for low in (0.05, 0.0, 0.3))
    return rng, position, direction, distance, reach, ball


def test_ball_contains_sampled_points_of_the_lens():
    """Points of ball i that lie in ball j, too, are in the ball (q, r); all three branches."""
    rng, position, direction, distance, reach, ball = random_pairs()
    balls = collision_balls(position, direction, distance, reach, ball)
    other = position + distance[:, None] * direction
    hits = 0
    for _ in range(60):
        offset = rng.normal(size=position.shape)
        offset *= (np.sqrt(rng.uniform(size=len(offset))) / np.hypot(*offset.T))[:, None]
        point = position + reach[:, None] * offset
        common = np.hypot(*(point - other).T) <= ball
        hits += np.count_nonzero(common)
        outside = np.hypot(*(point - balls.centre).T) - balls.radius
        assert outside[common].max() <= 1e-9
    assert hits > 50_000
    chord = (distance**2 + reach**2 - ball**2) / (2.0 * distance)
    for branch in (chord < 0.0, chord > distance, (chord >= 0.0) & (chord <= distance)):
        assert np.count_nonzero(branch) > 100


def test_lens_ball_is_the_smallest():
    """Both ends of the common chord lie on the ball, at opposite sides."""
    one = np.ones(1)
    balls = collision_balls(np.zeros((1, 2)), np.array([[1.0, 0.0]]), 1.2 * one, one, 0.8 * one)
    x = (1.2**2 + 1.0 - 0.8**2) / 2.4
    assert balls.centre[0] == pytest.approx([x, 0.0])
    assert balls.radius[0] == pytest.approx(np.sqrt(1.0 - x * x))


def test_safe_set_keeps_the_distance():
    """h >= 0 implies d >= r_j: j's reach and both bodies never shrink behind i's reach."""
    _, position, direction, distance, reach, ball = random_pairs()
    barrier = collision_balls(position, direction, distance, reach, ball).barrier
    safe = barrier >= 0.0
    assert np.count_nonzero(safe) > 500
    assert (distance[safe] >= ball[safe] - 1e-9).all()


def test_barrier_is_continuous_where_the_balls_begin_to_touch():
    """Its slope is not: the half-chord grows like a square root, 1e-8 m gives 1e-4 m."""
    reach, ball = np.array([0.4, 0.4]), np.array([0.7, 0.7])
    distance = np.array([1.1 - 1e-8, 1.1 + 1e-8])
    barrier = collision_balls(
        np.zeros((2, 2)), np.array([[1.0, 0.0]] * 2), distance, reach, ball
    ).barrier
    assert barrier[0] == pytest.approx(barrier[1], abs=5e-4)
