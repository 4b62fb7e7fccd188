"""Below an emergency stop: robots brake, lie down softly, lie damped, and never jump up.

PyBullet is the oracle for what a robot does; bounds are about twice what is measured.
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest
from stopping import Stopping

from layered_cbf_ros.bags.audit.audit import audit
from layered_cbf_ros.bags.audit.findings import OK
from layered_cbf_ros.bags.run.run_record import load_run
from layered_cbf_ros.coordination.coordinator import Coordinator
from layered_cbf_ros.coordination.exchange import CoordinationInputs
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.interfaces import NS_PER_S, PlannedMotion, VelocityCommand
from layered_cbf_ros.messages.trajectory import TrajectoryReader, TrajectoryWriter
from layered_cbf_ros.plan_following import LOWEST, SINK_SPEED, follow
from layered_cbf_ros.robot_model import FALLEN_HEIGHT
from layered_cbf_ros.scenario import Push, Robot, World
from layered_cbf_ros.whole_body.lying import is_left_damped
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters

P, W = CoordinatorParameters(), WholeBodyParameters()
WEIGHT = 12.458 * 9.81
TRUNK_MASS = 4.713
STOP, RESET = 2.0, 6.0
LEVEL = np.eye(3)


def at(run, time):
    return int(np.searchsorted(run['time'], time - 1e-9))


def between(run, start, end):
    rows = slice(at(run, start), at(run, end))
    return {name: column[rows] for name, column in run.items()}


def touch_down(run):
    """Return the first row at which more than feet touches the ground."""
    return int(np.flatnonzero(run['belly'] > 0.0)[0])


def expect_soft_landing_and_rest(run, end):
    """It comes down slowly and level, and from then on lies still, only damped."""
    first = touch_down(run)
    assert STOP + 1.0 < run['time'][first] < STOP + 3.0
    assert run['com_velocity'][first, 2] > -0.2
    assert run['tilt'][at(run, STOP) :].max() < 2.0
    assert np.abs(run['torques']).max() < 33.5
    assert run['solved'][:, 1].all()
    lying = between(run, end - 0.5, end)
    assert set(lying['status']) == {'DAMPED'}
    assert np.hypot(*lying['com_velocity'][:, :2].T).max() < 0.02
    assert lying['base'].max() < FALLEN_HEIGHT
    np.testing.assert_allclose(lying['torques'], -2.0 * lying['joint_speed'], atol=1e-12)


@pytest.fixture(scope='module')
def whole():
    """Walk, stop, lie, be reset, walk on."""
    return Stopping(lambda t: STOP <= t < RESET).run(10.0)


def test_a_trotting_robot_comes_to_rest_and_lies_down(whole):
    walking, stopped = between(whole, STOP - 0.2, STOP), between(whole, STOP, RESET)
    assert walking['com_velocity'][:, 0].mean() > 0.4
    braked = between(whole, STOP, STOP + 0.7)
    way = braked['com'][-1, 0] - braked['com'][0, 0]
    assert 0.05 < way < 0.2
    assert braked['plan_speed'][-1] < P.sit_speed
    assert (np.diff(stopped['plan_height']) <= 0.0).all()
    expect_soft_landing_and_rest(between(whole, 0.0, RESET), RESET)


def test_the_ground_carries_a_lying_robot_by_belly_and_feet(whole):
    lying = between(whole, RESET - 0.5, RESET)
    carried = (lying['belly'] + lying['feet'].sum(axis=1)).mean()
    assert carried == pytest.approx(WEIGHT, rel=0.03)  # contacts flicker by a few N
    assert lying['belly'].mean() > 0.5 * WEIGHT


def test_after_the_reset_it_stands_up_without_a_jump_and_walks_on(whole):
    rising = between(whole, RESET, RESET + P.sit_time)
    assert np.ptp(rising['com'][:, 2]) > 0.15
    assert np.abs(rising['com_velocity'][:, 2]).max() < 0.25
    assert (rising['feet'].sum(axis=1) + rising['belly'] > 0.5 * WEIGHT)[10:].all()
    assert rising['tilt'].max() < 2.0
    after = between(whole, RESET + P.sit_time + 0.2, 10.0)
    assert np.abs(after['com'][:, 2] - 0.26).max() < 0.005
    assert after['com_velocity'][-200:, 0].mean() > 0.35
    assert whole['solved'].all()


def test_the_same_stop_twice_is_the_same_to_the_bit():
    first, second = (Stopping(lambda t: t >= 0.6).run(3.4) for _ in range(2))
    assert {'SOLVED', 'DAMPED'} <= set(first['status'])
    np.testing.assert_array_equal(first['torques'], second['torques'])


@pytest.mark.parametrize('part', [-0.2, 0.2])
def test_an_unknown_payload_changes_little(part):
    run = Stopping(lambda t: t >= STOP, payload=part * TRUNK_MASS).run(5.5)
    expect_soft_landing_and_rest(run, 5.5)


@pytest.mark.parametrize('stop', [STOP, STOP + 0.07])
def test_it_stops_on_slippery_ground_when_it_knows_of_it(stop):
    """Friction 0.4, of which the controllers use 0.8, in two phases of the gait."""
    controllers = {
        'mpc': replace(GroundForceParameters(), friction=0.32),
        'wbc': replace(W, friction=0.32),
    }
    slippery = World(friction=0.4)
    run = Stopping(lambda t: t >= stop, world=slippery, **controllers).run(5.5)
    expect_soft_landing_and_rest(run, 5.5)


def test_a_push_moves_a_lying_robot_but_does_not_wake_it():
    push = Push('a1', at=5.0, duration=0.1, force=(0.0, 60.0, 0.0))
    run = Stopping(lambda t: t >= STOP, world=World(pushes=(push,))).run(6.0)
    expect_soft_landing_and_rest(run, 6.0)


def test_when_the_mpc_falls_silent_it_lies_down_all_the_same():
    run = Stopping(lambda t: t >= STOP, mpc_alive=lambda t: t < STOP + 0.3).run(5.5)
    expect_soft_landing_and_rest(run, 5.5)


@pytest.mark.parametrize('silent', [STOP + 0.8, STOP + 1.7])
def test_when_the_coordinator_falls_silent_amid_the_sit_it_lies_down(silent):
    run = Stopping(lambda t: t >= STOP, coordinator_alive=lambda t: t < silent).run(6.0)
    expect_soft_landing_and_rest(run, 6.0)


def test_a_new_coordinator_that_knows_of_no_stop_does_not_make_it_jump_up():
    """It plans to stand at once; who lies stays there, until stopped and reset once more."""
    stopped = [(STOP, 5.0), (5.6, 7.8)]
    run = Stopping(
        lambda t: any(start <= t < end for start, end in stopped),
        coordinator_alive=lambda t: t != 5.0,
    ).run(10.2)
    assert run['plan_height'][at(run, 5.5)] == 0.0
    expect_soft_landing_and_rest(between(run, 0.0, 5.6), 5.6)
    assert set(between(run, 5.0, 7.8)['status']) == {'DAMPED'}
    assert run['com'][-1, 2] == pytest.approx(0.26, abs=0.005)


def test_a_new_coordinator_amid_the_rise_lets_it_sink_back():
    run = Stopping(lambda t: 0.5 <= t < 4.0, coordinator_alive=lambda t: t != 5.0).run(6.0)
    assert run['com'][at(run, 5.0), 2] > 0.12
    assert run['com_velocity'][at(run, 5.0) :, 2].max() < 0.2
    assert run['base'][-1] < FALLEN_HEIGHT
    assert run['status'][-1] == 'DAMPED'


DRIVEN = """
description: An A1 is driven, stopped, reset and driven on.
duration: 8.4
robots:
  - {name: a1_0, position: [0.0, 0.0]}
operator:
  - {at: 0.3, steer: all, enable: true, x: 1.0}
  - {at: 1.4, enable: true, x: 1.0, e_stop: true}
  - {at: 1.6}
  - {at: 4.4, reset: true}
  - {at: 5.6}
  - {at: 7.6, steer: all, enable: true, x: 1.0}
"""


@pytest.mark.lockstep
@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_a_whole_graph_that_is_stopped_passes_its_verdict_and_its_audit(tmp_path):
    """Every layer a process of its own; the stop comes from a joystick."""
    from live_run import LiveRun

    (tmp_path / 'driven.yaml').write_text(DRIVEN)
    run = LiveRun(tmp_path / 'driven.yaml', tmp_path / 'run')
    assert run.end() == 0, run.said
    summary = run.summary()
    assert summary['e_stop_times_s'] == pytest.approx([1.4], abs=0.01)
    assert (summary['falls'], summary['solver_failures']) == (0, 0)
    audited = audit(run.output)
    assert audited.status == OK, audited.checks
    record = load_run(run.output)
    base, times = record.motions['a1_0'].configurations[:, 2], record.state.times
    assert base[(times > 4.0) & (times < 4.4)].max() < FALLEN_HEIGHT
    assert base[-1] == pytest.approx(0.28, abs=0.01)
    speed = record.motions['a1_0'].rates[:, 0]
    assert speed[times > 8.3].mean() > 0.1


# --- The plan -----------------------------------------------------------------------------------


def stopped_plans(seed, stopped):
    """Yield motions of three robots in motion, and whether the stop was latched, by tick."""
    rng = np.random.default_rng(seed)
    robots = [Robot(f'a1_{i}', (2.0 * i, 0.0)) for i in range(3)]
    coordinator = Coordinator(P, robots, (), 200)
    state = coordinator.start(0)
    state = replace(state, velocities=rng.uniform(-0.4, 0.4, (3, 2)))
    commands = tuple(VelocityCommand(*rng.uniform(-0.5, 0.5, 3)) for _ in robots)
    for tick in range(1600):
        latched = stopped(tick / 200)
        inputs = CoordinationInputs(
            state.stamp_ns, state.positions, state.velocities, np.zeros(3, dtype=bool), (),
            commands, state.yaws, latched,
        )  # fmt: skip
        result = coordinator.step(state, inputs)
        state = result.state
        yield latched, result.motions


@pytest.mark.parametrize('seed', range(4))
def test_the_speed_of_a_stopped_plan_never_grows_and_it_sits_only_at_rest(seed):
    last = None
    for latched, motions in stopped_plans(seed, lambda t: t >= 1.0):
        speeds = np.array([np.hypot(*motion.velocity) for motion in motions])
        if last is not None and latched:
            assert (speeds <= last + 1e-12).all()
        last = speeds if latched else None
        assert all(m.height == 0.0 or np.abs(m.velocity).max() < P.sit_speed for m in motions)
    assert speeds.max() < 1e-3
    assert [motion.height for motion in motions] == pytest.approx([-P.sit_depth] * 3)


@pytest.mark.parametrize('reset', [2.0, 2.6, 5.0])
def test_height_goes_down_then_up_without_a_step_at_the_told_rate(reset):
    """Its steps are its rate times the period, to second order of the smooth step."""
    stop = 0.5
    rows = list(stopped_plans(0, lambda t: stop <= t < reset))
    height = np.array([[m.height for m in motions] for _, motions in rows])
    rate = np.array([[m.vertical_velocity for m in motions] for _, motions in rows])
    latched = np.array([on for on, _ in rows])
    steps = np.diff(height, axis=0)
    assert (steps[latched[:-1]] <= 1e-15).all()  # of rounding
    assert (steps[~latched[:-1]] >= -1e-15).all()
    dt, curvature = 1 / 200, 6.0 * P.sit_depth / P.sit_time**2
    assert np.abs(steps - dt * rate[:-1]).max() < 0.51 * curvature * dt * dt + 1e-9
    assert height.min() < -0.02
    assert (height[-1] == 0.0).all()
    assert not np.signbit(height[0]).any()


def test_the_height_travels_in_the_message():
    """Read by another codec: translation.z and linear.z."""
    planting = pytest.importorskip('audit_planting')
    motion = PlannedMotion(7, *np.zeros((3, 2)), 0.0, 0.0, -0.11, -0.07)
    data = TrajectoryWriter(['a', 'b']).encode(7, [motion.standing(7, np.zeros(2), 0.0), motion])
    name = 'trajectory_msgs/msg/MultiDOFJointTrajectory'
    (point,) = planting.STORE.deserialize_cdr(data, name).points
    assert [t.translation.z for t in point.transforms] == [0.0, -0.11]
    assert [v.linear.z for v in point.velocities] == [0.0, -0.07]
    read = TrajectoryReader('b').read(data)
    assert (read.height, read.vertical_velocity) == (-0.11, -0.07)


# --- Following, and lying -----------------------------------------------------------------------


def sitting(height, rate=0.0, stamp_ns=0):
    return PlannedMotion(stamp_ns, *np.zeros((3, 2)), 0.0, 0.0, height, rate)


@pytest.mark.parametrize(('height', 'rate'), [(-0.1, -0.1), (-0.1, 0.1), (-0.001, 0.0)])
def test_who_is_not_up_when_the_plan_ends_goes_down_and_who_stands_stays(height, rate):
    for elapsed in (0.1, 0.5, 9.0):
        stamp = round(elapsed * NS_PER_S)
        motion = follow(sitting(height, rate), stamp, None, np.zeros(2), 0.0, 1.0).motion
        expected = max(height - SINK_SPEED * elapsed, LOWEST)
        assert motion.height == pytest.approx(expected, abs=1e-12)
        assert motion.vertical_velocity == (-SINK_SPEED if expected > LOWEST else 0.0)
        standing = follow(sitting(0.0), stamp, None, np.zeros(2), 0.0, 1.0).motion
        assert (standing.height, standing.vertical_velocity) == (0.0, 0.0)


def tilted(degrees):
    angle = math.radians(degrees)
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])


LYING, UP = -0.199, 0.065


@pytest.mark.parametrize(
    ('damped', 'before', 'motion', 'com_height', 'rotation', 'expected'),
    [
        (False, sitting(0.0), sitting(0.0), 0.26, LEVEL, False),
        (False, sitting(-0.1), sitting(-0.1, -0.1), 0.16, LEVEL, False),
        (False, sitting(LYING), sitting(LYING, -0.001), UP, LEVEL, True),  # it has sat down
        (False, sitting(0.0), sitting(0.0), 0.1, LEVEL, True),  # it has collapsed
        (False, sitting(0.0), sitting(0.0), 0.26, tilted(34.0), False),
        (False, sitting(0.0), sitting(0.0), 0.26, tilted(36.0), True),
        (False, sitting(-0.1), sitting(0.0), 0.16, LEVEL, True),  # the plan leaps up
        (True, sitting(LYING), sitting(LYING, 0.001), UP, LEVEL, False),  # it may rise
        (True, sitting(LYING), sitting(LYING, 0.001), UP, tilted(36.0), True),
        (True, sitting(LYING), sitting(LYING), UP, LEVEL, True),
        (True, sitting(0.0), sitting(0.0), 0.26, LEVEL, True),
        (True, sitting(-0.1), sitting(-0.1, 0.1), UP, LEVEL, True),  # that plan began without it
        (False, sitting(LYING), sitting(LYING, 0.001), UP, LEVEL, False),  # it rises
        (False, None, sitting(0.0), UP, LEVEL, True),  # a new controller of one that lies
        (False, None, sitting(0.0), math.nan, LEVEL, True),
    ],
)  # fmt: skip
def test_who_is_left_damped(damped, before, motion, com_height, rotation, expected):
    assert is_left_damped(damped, before, motion, com_height, rotation, W) is expected
