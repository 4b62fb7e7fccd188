"""Reference motions: their velocity is the derivative of their position, and more."""

import math

import numpy as np
import pytest

from layered_cbf_ros.patterns import Circle, Line, Standing, Waypoints

PATTERNS = [
    Standing((1.0, -2.0)),
    Circle((4.0, 0.5), 1.5, 0.4, 0.3),
    Circle((4.0, 0.5), 1.5, -0.7, -1.0),
    Line((-2.0, 1.0), (2.0, -1.0), 0.4, 0.0),
    Line((-2.0, 1.0), (2.0, -1.0), 0.9, 0.7, math.inf),
    Line((0.0, 0.0), (0.0, 0.3), 2.0, 0.1),
    Waypoints(((0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (-1.0, 1.0)), 0.5),
]


@pytest.mark.parametrize('pattern', PATTERNS)
def test_velocity_is_the_derivative_of_position(pattern):
    """Central differences, error O(h^2 v^3 / r^2); at a corner no derivative exists."""
    h, corners = 1e-5, 0
    for t in np.random.default_rng(0).uniform(0.1, 30.0, 300):
        before, after = pattern.at(t - h), pattern.at(t + h)
        if np.linalg.norm(after[1] - before[1]) > 1e-3:
            corners += 1
            continue
        slope = (after[0] - before[0]) / (2 * h)
        np.testing.assert_allclose(pattern.at(t)[1], slope, atol=1e-8)
    assert corners < 3


@pytest.mark.parametrize('speed', [0.4, -0.4])
def test_a_positive_speed_goes_round_counterclockwise(speed):
    circle = Circle((4.0, 0.0), 1.0, speed, phase=math.pi / 2)
    np.testing.assert_allclose(circle.at(0.0)[0], (4.0, 1.0), atol=1e-15)
    for t in np.linspace(0.0, 20.0, 50):
        position, velocity = circle.at(t)
        arm = position - (4.0, 0.0)
        assert np.linalg.norm(arm) == pytest.approx(1.0)
        assert arm[0] * velocity[1] - arm[1] * velocity[0] == pytest.approx(speed)


def test_a_line_is_walked_to_and_fro():
    line = Line((-2.0, 1.0), (2.0, -1.0), 0.4, acceleration=math.inf)
    there = math.hypot(4.0, 2.0) / 0.4
    np.testing.assert_allclose(line.at(0.0)[0], (-2.0, 1.0))
    np.testing.assert_allclose(line.at(there)[0], (2.0, -1.0), atol=1e-12)
    np.testing.assert_allclose(line.at(1.5 * there)[0], (0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(line.at(2.0 * there + 1.0)[0], line.at(1.0)[0], atol=1e-12)
    later = Line(line.start, line.end, 0.4, 0.25, math.inf)
    np.testing.assert_allclose(later.at(1.0)[0], line.at(1.0 + there / 2)[0])


@pytest.mark.parametrize(('length', 'top'), [(4.0, 0.4), (0.1, math.sqrt(0.5 * 0.1))])
def test_a_line_is_turned_with_a_bounded_acceleration(length, top):
    """Also a segment too short for its speed: then it is walked as fast as can be."""
    line, h = Line((0.0, 0.0), (length, 0.0), 0.4), 1e-3
    velocities = np.array([line.at(t)[1][0] for t in np.arange(0.0, 60.0, h)])
    assert np.abs(np.diff(velocities)).max() / h <= 0.5 + 1e-9
    assert velocities.max() == pytest.approx(top, rel=1e-3)
    places = np.array([line.at(t)[0][0] for t in np.arange(0.0, 60.0, h)])
    assert places.min() == pytest.approx(0.0, abs=1e-6)
    assert places.max() == pytest.approx(length, abs=1e-6)


def test_a_line_without_speed_rests_where_its_phase_has_it():
    position, velocity = Line((0.0, 0.0), (4.0, 0.0), 0.0, 0.75).at(3.0)
    np.testing.assert_allclose(position, (2.0, 0.0))
    np.testing.assert_allclose(velocity, 0.0)


def test_waypoints_are_passed_in_order_at_the_given_speed_and_the_last_is_kept():
    walk = Waypoints(((0.0, 0.0), (1.0, 0.0), (1.0, 2.0)), 0.5)
    np.testing.assert_allclose(walk.at(1.0)[0], (0.5, 0.0))
    np.testing.assert_allclose(walk.at(4.0)[0], (1.0, 1.0))
    np.testing.assert_allclose(walk.at(4.0)[1], (0.0, 0.5))
    np.testing.assert_allclose(walk.at(100.0), ((1.0, 2.0), (0.0, 0.0)))
