"""The coordinator in closed loop: distances kept, goals reached, faults survived."""

import math
from dataclasses import replace

import numpy as np
import pytest

from layered_cbf_ros.coordination import coordinator as coordinator_module
from layered_cbf_ros.coordination.coordinator import Coordinator
from layered_cbf_ros.coordination.desired_motion import desired_twist
from layered_cbf_ros.coordination.exchange import CoordinationInputs
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.planner_qp import QpStatus
from layered_cbf_ros.interfaces import Track, VelocityCommand
from layered_cbf_ros.patterns import Circle, Line
from layered_cbf_ros.scenario import Desired, Robot, VelocityStep, Wall

P = CoordinatorParameters(max_obstacles=3)
RATE = 50  # 50 Hz: twenty times fewer ticks
WALLS = (Wall('left', (0.0, 3.0), (0.0, -1.0)), Wall('right', (0.0, -3.0), (0.0, 1.0)))
COVARIANCE = np.diag([1e-4, 1e-4, 2.5e-3, 2.5e-3])
RUNNER = Robot('a1_0', (-8.0, 0.0), desired=Desired(goal=(10.0, 0.0)))
PATTERNS = (
    Circle((4.0, 0.0), 1.0, 0.4, math.pi),
    Circle((-4.0, 0.0), 1.0, 0.4, math.pi / 2),
    Line((-2.0, 1.0), (2.0, -1.0), 0.4, 0.25),
)
SWAP = (
    Robot('a1_0', (-3.0, 0.0), desired=Desired(goal=(3.0, 0.0))),
    Robot('a1_1', (3.0, 0.0), yaw=math.pi, desired=Desired(goal=(-3.0, 0.0))),
)


def told(state, tracks=(), commands=None, **changes):
    """Return inputs of robots that follow their plan exactly."""
    count = len(state.positions)
    inputs = CoordinationInputs(
        state.stamp_ns,
        state.positions.copy(),
        state.velocities.copy(),
        np.zeros(count, dtype=bool),
        tuple(tracks),
        commands or (None,) * count,
        state.yaws.copy(),
    )
    return replace(inputs, **changes)


def track(name, position, velocity=(0.0, 0.0), stamp_ns=0):
    return Track(name, stamp_ns, np.array(position), np.array(velocity), COVARIANCE, 0.3)


def closed_loop(robots, walls, obstacles, duration, coordinator=None):
    """Walk double integrators; return the last state, the least distance and the results."""
    coordinator = coordinator or Coordinator(P, robots, walls, RATE)
    state, least, results = coordinator.start(0), math.inf, []
    for k in range(round(duration * RATE)):
        seen = max(k / RATE - 0.02, 0.0)
        tracks = [
            track(f'o{i}', *pattern.at(seen), stamp_ns=round(seen * 1e9))
            for i, pattern in enumerate(obstacles)
        ]
        result = coordinator.step(state, told(state, tracks))
        state = result.state
        bodies = [pattern.at((k + 1) / RATE)[0] for pattern in obstacles]
        places = np.concatenate((state.positions, np.reshape(bodies, (-1, 2))))
        for i in range(len(robots)):
            gaps = np.hypot(*(places[i + 1 :] - places[i]).T)
            least = min(least, gaps.min(initial=math.inf))
        results.append(result)
    return state, least, results


def test_one_robot_passes_three_obstacles():
    """The paper's first scenario: within 45 s, at least 0.4 m between the surfaces."""
    state, least, results = closed_loop((RUNNER,), WALLS, PATTERNS, 45.0)
    assert np.hypot(*(state.positions[0] - (10.0, 0.0))) < 0.15
    assert least - 0.6 >= 0.4
    assert not any(result.solver_failed for result in results)
    assert max(abs(result.state.positions[0, 1]) for result in results) < 2.7


def test_four_robots_pass_each_other():
    """The paper's second scenario; the three on their patterns give way, too."""
    walkers = tuple(
        Robot(f'a1_{i + 1}', tuple(pattern.at(0.0)[0]), desired=Desired(pattern=pattern))
        for i, pattern in enumerate(PATTERNS)
    )
    state, least, results = closed_loop((RUNNER, *walkers), WALLS, (), 45.0)
    assert np.hypot(*(state.positions[0] - (10.0, 0.0))) < 0.15
    assert least - 0.6 >= 0.4
    assert not any(result.solver_failed for result in results)
    assert len(results[0].labels) == 6 + 8


def test_two_robots_swap_their_places_head_on():
    """An exactly symmetric meeting resolves, and both stop exactly at their goals."""
    state, least, _ = closed_loop(SWAP, (), (), 30.0)
    assert np.allclose(state.positions, [[3.0, 0.0], [-3.0, 0.0]], atol=0.01)
    assert np.abs(state.velocities).max() < 0.01
    assert least - 0.6 >= 0.2


@pytest.mark.parametrize('kind', ['AgentAgent', 'AgentObstacle'])
def test_a_flipped_sign_lets_bodies_touch(monkeypatch, kind):
    """The distances above come from the rows: with reversed rows robots collide."""
    honest = getattr(coordinator_module, kind)

    class Reversed(honest):
        def rows(self, scene):
            rows = super().rows(scene)
            return replace(rows, coefficients=-rows.coefficients)

    monkeypatch.setattr(coordinator_module, kind, Reversed)
    robots, obstacles = (SWAP, ()) if kind == 'AgentAgent' else ((RUNNER,), PATTERNS)
    _, least, _ = closed_loop(robots, (), obstacles, 20.0, Coordinator(P, robots, (), RATE))
    assert least < 0.6


def test_plan_obeys_its_limits_and_integrates_exactly():
    """phi+ = phi + dt v + dt^2 / 2 u, and the published motion extrapolates to it."""
    _, _, results = closed_loop((RUNNER,), WALLS, PATTERNS, 20.0)
    for result in results:
        assert np.abs(result.u).max() <= P.acceleration_limit + 1e-9
        assert np.abs(result.state.velocities).max() <= P.speed_limit + 1e-9
        later = result.motions[0].at(result.state.stamp_ns)
        assert np.allclose(later.position, result.state.positions[0], atol=1e-12)
        assert np.allclose(later.velocity, result.state.velocities[0], atol=1e-12)


def test_psi2_is_not_negative_unless_slack_says_so():
    """1e-5 is ten times the accuracy asked of the solver."""
    _, _, results = closed_loop((RUNNER,), WALLS, PATTERNS, 20.0)
    for result in results:
        assert (result.psi2 + result.slack >= -1e-5).all()


def test_same_inputs_give_the_same_plan_to_the_bit():
    one, other = (closed_loop(SWAP, (), (), 5.0)[0] for _ in range(2))
    assert one.positions.tobytes() == other.positions.tobytes()


def test_plan_that_is_not_finite_brakes_and_says_so():
    """A velocity of NaN can't be braked, but the other robot's is."""
    coordinator = Coordinator(P, SWAP, (), RATE)
    state = coordinator.start(0)
    state.velocities[:] = [[np.nan, 0.0], [-0.2, 0.0]]
    result = coordinator.step(state, told(state))
    assert result.status is QpStatus.NOT_FINITE
    assert result.solver_failed
    assert result.u[1] == pytest.approx([0.2 / P.brake_time, 0.0])


def test_bad_tracks_states_and_commands_are_ignored_and_counted():
    coordinator = Coordinator(P, SWAP, WALLS, RATE)
    state = coordinator.start(0)
    clean = coordinator.step(state, told(state))
    unknown = state.positions.copy()
    unknown[1] = np.nan
    dirty = coordinator.step(
        state,
        told(
            state,
            [track('bad', (math.nan, 0.0))],
            (VelocityCommand(math.nan, 0.0), None),
            positions=unknown,
        ),
    )
    assert dirty.rejected == 3
    assert clean.rejected == 0
    assert np.allclose(dirty.u, clean.u, atol=1e-5)
    assert dirty.labels == clean.labels


def test_nearest_tracks_are_kept_when_there_are_too_many():
    coordinator = Coordinator(P, (RUNNER,), (), RATE)
    state = coordinator.start(0)
    tracks = [track(f'o{x}', (x, 0.0)) for x in (9.0, 1.0, 8.0, 2.0, 0.0)]
    result = coordinator.step(state, told(state, tracks))
    assert result.tracks_left_out == 2
    assert result.labels == ('a1_0~o1.0', 'a1_0~o2.0', 'a1_0~o0.0')
    assert result.ball_labels == result.labels
    assert result.q.shape == (3, 2)


def test_fallen_robot_is_frozen_and_others_walk_around_it():
    """Robot 1 lies in the way, 5 cm off its plan: its plan waits where it lies."""
    robots = (SWAP[0], Robot('a1_1', (0.0, 0.0)))
    coordinator = Coordinator(P, robots, (), RATE)
    state, least = coordinator.start(0), math.inf
    place, fallen = np.array([0.03, 0.04]), np.array([False, True])
    for _ in range(25 * RATE):
        inputs = told(state, fallen=fallen)
        inputs.positions[1] = place
        result = coordinator.step(state, inputs)
        state = result.state
        least = min(least, np.hypot(*(state.positions[0] - place)))
        assert result.alarms.tolist() == [False, True]
        assert np.array_equal(state.positions[1], place)
    assert least >= 0.6
    assert np.allclose(state.positions[0], (3.0, 0.0), atol=0.05)


def test_robot_far_from_its_plan_raises_an_alarm_until_it_is_slow():
    coordinator = Coordinator(P, SWAP, (), RATE)
    state = coordinator.start(0)
    inputs = told(state)
    inputs.positions[0] += (0.0, P.tracking_alarm + 0.01)
    inputs.velocities[0] = (0.0, 0.5)
    result = coordinator.step(state, inputs)
    assert result.alarms.tolist() == [True, False]
    assert np.array_equal(result.motions[0].position, inputs.positions[0])
    assert np.array_equal(result.motions[0].velocity, (0.0, 0.0))
    moving = told(result.state, velocities=inputs.velocities)
    assert coordinator.step(result.state, moving).alarms[0]
    assert not coordinator.step(result.state, told(result.state)).alarms[0]


def test_old_track_keeps_the_robot_farther_away():
    """Fear grows with age: the same obstacle, last seen a second ago, has a smaller psi0."""
    coordinator = Coordinator(P, (RUNNER,), (), RATE)
    state = coordinator.start(0)
    state = replace(state, stamp_ns=10**9)
    fresh, stale = (
        coordinator.step(state, told(state, [track('o', (-5.0, 0.0), (-0.3, 0.0), stamp)]))
        for stamp in (10**9, 0)
    )
    assert stale.psi0[0] < fresh.psi0[0] - 0.3


def test_missed_ticks_let_the_plan_coast_but_not_run_away():
    coordinator = Coordinator(P, (RUNNER,), (), RATE)
    state = coordinator.start(0)
    state.velocities[0] = (0.4, 0.0)
    result = coordinator.step(state, told(state, stamp_ns=10**9))
    assert result.motions[0].stamp_ns == 10**9
    moved = result.motions[0].position[0] - state.positions[0, 0]
    assert moved == pytest.approx(0.4 * P.longest_gap)


def test_command_overrides_the_goal_and_turns_with_the_robot():
    """Forward of a robot that looks to the left (+y) is +y; a goal alone never turns it."""
    robot = replace(RUNNER, yaw=math.pi / 2)
    coordinator = Coordinator(P, (robot,), (), RATE)
    state = coordinator.start(0)
    for _ in range(3 * RATE):
        result = coordinator.step(state, told(state, commands=(VelocityCommand(0.3, 0.0),)))
        state = result.state
    assert np.allclose(state.velocities[0], (0.0, 0.3), atol=0.01)
    result = coordinator.step(state, told(state, commands=(VelocityCommand(0.0, 0.0, 9.0),)))
    assert 0.0 < result.state.yaw_rates[0] <= P.yaw_acceleration_limit / RATE + 1e-12
    assert coordinator.step(state, told(state)).state.yaws[0] == pytest.approx(math.pi / 2)


def test_velocity_script_holds_each_step_in_its_frame():
    script = (VelocityStep(1.0, x=0.3), VelocityStep(2.0, y=0.2, yaw_rate=0.5))
    for time, expected in ((0.5, (0.0, 0.0, 0.0)), (1.5, (0.0, 0.3, 0.0)), (9.0, (-0.2, 0.0, 0.5))):
        wish = desired_twist(Desired(velocity=script), None, time, (0.0, 0.0), math.pi / 2, (), P)
        assert wish == pytest.approx(expected, abs=1e-12)
    in_world = Desired(velocity=script, frame='world')
    wish = desired_twist(in_world, None, 1.5, (0.0, 0.0), math.pi / 2, (), P)
    assert wish == pytest.approx((0.3, 0.0, 0.0))


def test_pattern_is_followed_closely():
    """Alone on its circle a robot stays within 5 cm: the preview feeds forward."""
    pattern = Circle((0.0, 0.0), 1.0, 0.4)
    robot = Robot('a1_0', (1.0, 0.0), desired=Desired(pattern=pattern))
    state, _, _ = closed_loop((robot,), (), (), 20.0)
    assert np.hypot(*(state.positions[0] - pattern.at(20.0)[0])) < 0.05


def test_robot_that_stands_keeps_its_place():
    """Its gait can't take it away; the other walks around it."""
    robots = (SWAP[0], Robot('a1_1', (0.0, 0.1), gait='stand'))
    state, least, _ = closed_loop(robots, (), (), 25.0)
    assert np.array_equal(state.positions[1], (0.0, 0.1))
    assert least >= 0.6
    assert np.allclose(state.positions[0], (3.0, 0.0), atol=0.05)


def test_a_coordinator_that_starts_anew_begins_where_the_robots_are():
    """Measured poses go before the scenario's; what is unknown is taken from it."""
    state = Coordinator(P, SWAP, (), RATE).start(
        5, np.array([[1.0, 2.0], [np.nan, np.nan]]), np.array([0.7, np.nan])
    )
    assert state.positions.tolist() == [[1.0, 2.0], [3.0, 0.0]]
    assert state.yaws.tolist() == [0.7, math.pi]
    assert not state.velocities.any()


def test_a_plan_freezes_at_the_measured_heading():
    coordinator = Coordinator(P, SWAP, (), RATE)
    state = coordinator.start(0)
    measured = told(state, fallen=np.array([True, False]), yaws=np.array([0.9, np.nan]))
    motions = coordinator.step(state, measured).motions
    assert motions[0].yaw == 0.9
    assert motions[1].yaw == math.pi
