"""The tracker against exact Gaussian conditioning, brute force and its own covariance."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.patterns import Circle, Line
from layered_cbf_ros.perception.assignment import assign
from layered_cbf_ros.perception.kalman import predict, update
from layered_cbf_ros.perception.obstacle_tracker import ObstacleTracker
from layered_cbf_ros.perception.parameters import ObstacleTrackerParameters

DT_NS = 10_000_000
DT = DT_NS / NS_PER_S
PARAMETERS = ObstacleTrackerParameters()


def points(*pairs):
    return np.array(pairs, dtype=float).reshape(-1, 2)


class Run:
    """A tracker, its state and its latest tracks, all by name."""

    def __init__(self, parameters=PARAMETERS):
        self.tracker = ObstacleTracker(parameters)
        self.state = self.tracker.start(0)
        self.tracks, self.rejected = {}, 0

    def see(self, tick, detections):
        result = self.tracker.step(self.state, tick * DT_NS, detections)
        self.state, self.rejected = result.state, result.rejected
        self.tracks = {track.name: track for track in result.tracks}
        return self


def flow(dt, acceleration):
    """The motion model written out anew: x' = F x + w, w ~ (0, Q)."""
    ones = np.eye(2)
    forward = np.block([[ones, dt * ones], [0 * ones, ones]])
    drift = np.block([[dt**3 / 3 * ones, dt**2 / 2 * ones], [dt**2 / 2 * ones, dt * ones]])
    return forward, acceleration**2 * drift


def test_the_filter_is_gaussian_conditioning():
    """Mean and covariance of x_5 given z_1..z_5, from their joint distribution at once."""
    random = np.random.default_rng(0)
    a, noise = 0.7, 0.05
    mean, covariance = random.normal(size=4), np.diag([1.0, 2.0, 0.5, 0.3])
    means, joint = [mean], covariance
    dts, measured = random.uniform(0.1, 0.5, 5), random.normal(size=(5, 2))
    estimate = (mean, covariance)
    for dt, z in zip(dts, measured, strict=True):
        forward, drift = flow(dt, a)
        last = joint[-4:]
        joint = np.block([[joint, last.T @ forward.T], [forward @ last, np.zeros((4, 4))]])
        joint[-4:, -4:] = forward @ last[:, -4:] @ forward.T + drift
        means.append(forward @ means[-1])
        estimate = update(*predict(*estimate, dt, a), z, noise)
    seen = np.concatenate([[4 * k, 4 * k + 1] for k in range(1, 6)])
    spread = joint[np.ix_(seen, seen)] + noise**2 * np.eye(10)
    gain = np.linalg.solve(spread, joint[np.ix_(seen, range(20, 24))]).T
    surprise = measured.ravel() - np.concatenate(means)[seen]
    np.testing.assert_allclose(estimate[0], means[-1] + gain @ surprise, atol=1e-10)
    left = joint[-4:, -4:] - gain @ joint[np.ix_(seen, range(20, 24))]
    np.testing.assert_allclose(estimate[1], left, atol=1e-10)


@pytest.mark.parametrize('seed', range(30))
def test_no_other_assignment_is_cheaper(seed):
    random = np.random.default_rng(seed)
    rows = int(random.integers(1, 5))
    cost = random.normal(size=(rows, rows + int(random.integers(0, 3))))
    cost[random.random(cost.shape) < 0.3] = 1e6
    columns = assign(cost)
    assert len(set(columns)) == rows
    every = itertools.permutations(range(cost.shape[1]), rows)
    best = min(sum(cost[i, j] for i, j in enumerate(choice)) for choice in every)
    assert sum(cost[i, j] for i, j in enumerate(columns)) == pytest.approx(best)


def test_errors_are_as_large_as_the_covariance_says():
    """Truths from the model itself: mean squared error in units of P is 4, and of S is 2.

    Over n runs the mean of a chi-square of k degrees spreads by sqrt(2 k / n): 4 sigma.
    """
    runs, errors, surprises = 100, [], []
    noise = PARAMETERS.noise
    for seed in range(runs):
        random = np.random.default_rng(seed)
        truth = np.append(
            random.uniform(-5, 5, 2), PARAMETERS.initial_speed * random.normal(size=2)
        )
        forward, drift = flow(DT, PARAMETERS.acceleration)
        root, run = np.linalg.cholesky(drift), Run()
        for tick in range(1, 31):
            truth = forward @ truth + root @ random.normal(size=4)
            z = truth[:2] + noise * random.normal(size=2)
            if tick == 30:
                (track,) = run.see(tick, None).tracks.values()
                spread = track.covariance[:2, :2] + noise**2 * np.eye(2)
                surprise = z - track.position
                surprises.append(surprise @ np.linalg.solve(spread, surprise))
            tracks = run.see(tick, points(z)).tracks
        (track,) = tracks.values()
        error = np.append(track.position, track.velocity) - truth
        errors.append(error @ np.linalg.solve(track.covariance, error))
    assert np.mean(errors) == pytest.approx(4.0, abs=4 * math.sqrt(8 / runs))
    assert np.mean(surprises) == pytest.approx(2.0, abs=4 * math.sqrt(4 / runs))


MOTIONS = (Circle((4, 0), 1.0, 0.4), Line((-2, 1), (2, -1), 0.4, 0.0, math.inf))


@pytest.mark.parametrize('motion', MOTIONS)
def test_the_velocity_of_an_obstacle_is_found(motion):
    """Also where a line turns back at once: a short error, but never a lost name."""
    random = np.random.default_rng(1)
    run, errors = Run(), []
    for tick in range(1600):
        position, velocity = motion.at(tick * DT)
        run.see(tick, points(position + 0.005 * random.normal(size=2)))
        if tick > 100:
            assert list(run.tracks) == ['obstacle_1']
            errors.append(np.linalg.norm(run.tracks['obstacle_1'].velocity - velocity))
    assert np.median(errors) < 0.06
    assert np.mean(np.array(errors) > 0.15) < 0.05


def test_crossing_obstacles_keep_their_names():
    """Paths that cross, 0.1 m apart at their nearest: ten times the noise."""
    random = np.random.default_rng(2)
    run = Run()
    for tick in range(600):
        t = tick * DT
        truths = np.array([[-1.5 + 0.5 * t, 0.05], [0.05, -1.5 + 0.5 * t - 0.1]])
        seen = truths + 0.01 * random.normal(size=(2, 2))
        run.see(tick, random.permutation(seen))
        if tick == 10:
            names = {
                name: int(np.argmin(np.linalg.norm(truths - track.position, axis=1)))
                for name, track in run.tracks.items()
            }
            assert sorted(names.values()) == [0, 1]
        if tick > 10:
            for name, k in names.items():
                assert np.linalg.norm(run.tracks[name].position - truths[k]) < 0.05


def test_a_lost_obstacle_grows_uncertain_and_is_known_again():
    """2 s unseen: the position's variance is p + 2 c t + v t^2 + a^2 t^3 / 3."""
    run = Run()
    for tick in range(100):
        run.see(tick, points((0.4 * tick * DT, 1.0)))
    before = run.tracks['obstacle_1']
    for tick in range(100, 300):
        run.see(tick, points())
    lost, t = run.tracks['obstacle_1'], 2.0
    p, c, v = before.covariance[0, 0], before.covariance[0, 2], before.covariance[2, 2]
    expected = p + 2 * c * t + v * t**2 + PARAMETERS.acceleration**2 * t**3 / 3
    assert lost.covariance[0, 0] == pytest.approx(expected, rel=1e-9)
    assert lost.covariance[0, 0] > 100 * p
    np.testing.assert_allclose(lost.position, before.position + t * before.velocity, atol=1e-9)
    run.see(300, points((0.4 * 3.0 + 0.2, 1.1)))
    assert list(run.tracks) == ['obstacle_1']
    assert run.tracks['obstacle_1'].position[0] == pytest.approx(1.4, abs=0.01)


def test_a_lost_obstacle_does_not_rob_its_neighbour():
    """After 2 s the lost one may be anywhere, so it is near to each detection."""
    random = np.random.default_rng(4)
    run = Run()
    for tick in range(300):
        seen = points((0.0, 0.0), (0.4, 0.0)) if tick < 100 else points((0.4, 0.0))
        run.see(tick, seen + 0.01 * random.normal(size=seen.shape))
    assert run.tracks['obstacle_2'].covariance[0, 0] < 1e-3
    assert run.tracks['obstacle_1'].covariance[0, 0] > 1e-2


def test_an_obstacle_unseen_for_long_is_forgotten_and_its_name_is_not_used_again():
    run = Run()
    for tick in range(10):
        run.see(tick, points((0, 0)))
    run.see(9 + round(PARAMETERS.death_time / DT), None)
    assert list(run.tracks) == ['obstacle_1']
    run.see(10 + round(PARAMETERS.death_time / DT), None)
    assert not run.tracks
    for tick in range(400, 410):
        run.see(tick, points((0, 0)))
    assert list(run.tracks) == ['obstacle_2']


def test_a_ghost_is_never_believed():
    random = np.random.default_rng(3)
    run = Run()
    for tick in range(300):
        ghost = random.uniform(-10, 10, 2)
        run.see(tick, points((0, 0), ghost) if tick % 3 == 0 else points((0, 0)))
        assert set(run.tracks) <= {'obstacle_1'}
    assert len(run.state.frames[-1].objects) <= 1 + PARAMETERS.birth_window


def test_an_object_is_believed_from_its_third_detection_on():
    run = Run()
    assert not run.see(0, points((1, 2))).tracks
    assert not run.see(1, points((1, 2))).tracks
    track = run.see(2, points((1, 2))).tracks['obstacle_1']
    assert (track.stamp_ns, track.radius) == (2 * DT_NS, 0.0)
    np.testing.assert_allclose(track.position, (1, 2), atol=1e-12)


def test_what_is_not_finite_is_rejected_and_counted():
    clean, dirty = Run(), Run()
    for tick in range(10):
        clean.see(tick, points((1, 2)))
        dirty.see(tick, points((math.nan, 0), (1, 2), (0, math.inf)))
        assert (clean.rejected, dirty.rejected) == (0, 2)
    assert dirty.tracks.keys() == clean.tracks.keys()
    np.testing.assert_array_equal(
        dirty.tracks['obstacle_1'].covariance, clean.tracks['obstacle_1'].covariance
    )


def test_a_message_out_of_order_counts_as_if_it_had_come_in_time():
    motion = Circle((0, 0), 1.0, 0.5)
    order = list(range(40))
    order.insert(35, order.pop(25))
    runs = []
    for ticks in (range(40), order):
        run = Run()
        for tick in ticks:
            run.see(tick, points(motion.at(tick * DT)[0]))
            assert run.rejected == 0
        runs.append(run)
    ours, theirs = (run.tracks['obstacle_1'] for run in runs)
    assert ours.stamp_ns == theirs.stamp_ns
    np.testing.assert_array_equal(ours.position, theirs.position)
    np.testing.assert_array_equal(ours.covariance, theirs.covariance)


def test_a_late_message_gives_no_births():
    """Else names that were told already would change when all is taken in again."""
    run = Run()
    for tick in (0, 1, 2, 4):
        run.see(tick, points((0, 0)))
    run.see(3, points((0, 0), (5, 5)))
    for tick in range(5, 10):
        run.see(tick, points((0, 0), (-5, 5)))
    assert list(run.tracks) == ['obstacle_1', 'obstacle_2']


def test_a_message_too_late_or_given_twice_is_rejected_and_counted():
    run = Run()
    for tick in range(50):
        run.see(tick, points((0, 0)))
    before = run.tracks['obstacle_1']
    for tick in (10, 49):
        run.see(tick, points((0.001, 0), (3, 3)))
        assert run.rejected == 2
    np.testing.assert_array_equal(run.tracks['obstacle_1'].position, before.position)


def watched(ticks):
    run = Run()
    for tick in range(ticks):
        run.see(tick, points((0, 0)))
    return run


WALL_CLOCK = 170_000_000_000  # in ticks: far from any simulated time
OTHER_WALL_CLOCK = WALL_CLOCK + 1 + round(PARAMETERS.death_time / DT)


@pytest.mark.parametrize('wrong', [(WALL_CLOCK,), (WALL_CLOCK, OTHER_WALL_CLOCK)])
def test_a_message_with_a_foreign_stamp_is_rejected_and_changes_nothing(wrong):
    run, other = watched(10), watched(10)
    for tick in wrong:
        run.see(tick, points((0, 0), (3, 3)))
        assert run.rejected == 2
        assert run.state.stamp_ns == 9 * DT_NS
    run.see(10, points((0.001, 0)))
    other.see(10, points((0.001, 0)))
    assert run.rejected == 0
    ours, theirs = (it.tracks['obstacle_1'] for it in (run, other))
    assert ours.stamp_ns == theirs.stamp_ns
    np.testing.assert_array_equal(ours.covariance, theirs.covariance)


@pytest.mark.parametrize('begin', [WALL_CLOCK, 1000])
def test_a_jump_that_is_confirmed_begins_anew_without_using_a_name_again(begin):
    run = watched(10)
    for tick in range(begin, begin + 5):
        run.see(tick, points((1, 2)))
        assert run.rejected == (tick == begin)
    assert list(run.tracks) == ['obstacle_2']
    assert run.tracks['obstacle_2'].stamp_ns == (begin + 4) * DT_NS
    for tick in range(5):  # and back, as when the plant was started again
        run.see(tick, points((1, 2)))
    assert list(run.tracks) == ['obstacle_3']


def test_two_clocks_that_take_turns_do_not_throw_the_tracker_about():
    run = watched(10)
    for tick in range(10, 20):
        run.see(WALL_CLOCK + tick, points((5, 5)))
        run.see(tick, points((0, 0)))
    assert list(run.tracks) == ['obstacle_1']


def test_a_step_leaves_the_state_it_was_given_alone():
    run = Run()
    for tick in range(5):
        run.see(tick, points((0, 0), (1, 1)))
    given = replace(run.state)
    results = [run.tracker.step(given, 6 * DT_NS, points((0, 0.01), (1, 1))) for _ in range(2)]
    for once, again in zip(*(result.tracks for result in results), strict=True):
        np.testing.assert_array_equal(once.position, again.position)
