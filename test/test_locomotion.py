"""One robot walks in simulation: MPC, whole-body controller and PyBullet in closed loop.

Bounds are about twice what is measured, so that they tell of a change for the worse.
"""

import dataclasses
import math

import numpy as np
import pytest
from closed_loop import ClosedLoop, walk

from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.interfaces import NS_PER_S, PlannedMotion
from layered_cbf_ros.scenario import Push, World
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters

STAND = GroundForceParameters(gait='stand')
SETTLED = 2.0
"""Start, ramp and their echo are over by then [s]."""

TRUNK_MASS = 4.713
MM = 1e-3


def one_hertz(amplitude, stamp):
    """Return a 1 - cos wave from rest at 0.5 s: value, rate, acceleration."""
    w = 2.0 * math.pi
    t = max(0.0, stamp / NS_PER_S - 0.5)
    cos, sin = math.cos(w * t), math.sin(w * t)
    moving = 1.0 if t > 0.0 else 0.0
    value, rate, acceleration = 1.0 - cos, w * sin, moving * w * w * cos
    return tuple(0.5 * amplitude * x for x in (value, rate, acceleration))


def sway(stamp):
    left = [np.array([0.0, y]) for y in one_hertz(0.06, stamp)]
    return PlannedMotion(stamp, *left, 0.0, 0.0)


def squat(stamp):
    z, rate, acceleration = one_hertz(-0.06, stamp)
    return 0.26 + z, rate, acceleration


def mean_velocity(recording):
    """Return the mean velocity of CoM and reference over whole gait periods [m/s]."""
    whole = 400 * ((len(recording.time) - 1) // 400)
    duration = recording.time[whole] - recording.time[0]
    com = (recording.com[whole] - recording.com[0]) / duration
    return com, (recording.reference[whole] - recording.reference[0]) / duration


def test_it_stands_still():
    run = ClosedLoop(walk(), mpc=STAND).run(2.0)
    assert run.failures == 0
    assert np.abs(run.after(1.0).error).max() < 0.1 * MM
    # It falls for a tick before the first torque acts: 1e-2 m/s, 0.36 mm at these gains.
    assert np.abs(run.error).max() < 0.5 * MM
    assert run.after(1.0).foot_forces.sum(axis=1) == pytest.approx(12.458 * 9.81, abs=0.1)


@pytest.mark.parametrize('stance', ['sway', 'squat', 'both'])
def test_it_squats_and_sways_at_one_hertz(stance):
    motion = walk() if stance == 'squat' else sway
    height = None if stance == 'sway' else squat
    run = ClosedLoop(motion, mpc=STAND, height=height).run(3.5)
    moving = run.after(1.0)
    assert run.failures == 0
    assert np.ptp(moving.reference[:, 1:], axis=0).max() > 0.059
    assert np.abs(moving.error).max() < 0.4 * MM
    assert np.abs(run.tilt).max() < 0.05


@pytest.mark.parametrize(
    'velocity',
    [
        {'forward': 0.0},
        {'forward': 0.4},
        {'forward': 0.8},
        {'left': 0.3},
        {'yaw_rate': 0.5},
        {'forward': 0.4, 'yaw_rate': 0.5},
    ],
    ids=str,
)
def test_it_trots_as_it_is_told(velocity):
    run = ClosedLoop(walk(**velocity)).run(10.0)
    steady = run.after(SETTLED)
    reached, wanted = mean_velocity(steady)
    assert run.failures == 0
    np.testing.assert_allclose(reached, wanted, atol=max(0.01 * np.linalg.norm(wanted), 1e-3))
    assert np.abs(run.tilt).max() < 0.3
    assert np.hypot(*run.error[:, :2].T).max() < 8.0 * MM
    assert np.abs(run.error[:, 2]).max() < 1.0 * MM
    assert np.degrees(np.abs(run.yaw - run.yaw_reference)).max() < 0.5
    assert np.abs(run.torques).max() < 20.0


@pytest.mark.parametrize(('force', 'error', 'tilt'), [(60.0, 0.1, 3.0), (-150.0, 0.3, 15.0)])
def test_a_push_from_the_side_does_not_fell_it(force, error, tilt):
    """0.1 s of 60 N and of 150 N give it 0.5 and 1.2 m/s."""
    push = Push('a1', at=2.05, duration=0.1, force=(0.0, force, 0.0))
    run = ClosedLoop(walk(forward=0.4), world=World(pushes=(push,))).run(6.0)
    thrown = run.error[:, 1] * math.copysign(1.0, force)
    assert 0.03 < thrown.max() < error  # pushed aside, and to the right side
    assert np.abs(run.tilt).max() < tilt
    assert np.abs(run.torques).max() <= 33.5 + 1e-6
    # Foot placement lets it swing to and fro once a second, less each time.
    back = run.after(5.0)
    assert np.hypot(*back.error[:, :2].T).max() < 15.0 * MM
    assert np.abs(back.tilt).max() < 0.5


@pytest.mark.parametrize('friction', [0.4, 0.8])
def test_friction_of_the_ground_hardly_matters(friction):
    run = ClosedLoop(walk(forward=0.4), world=World(friction=friction)).run(4.0)
    assert np.hypot(*run.error[:, :2].T).max() < 8.0 * MM
    assert np.abs(run.tilt).max() < 0.3


@pytest.mark.parametrize('part', [-0.2, 0.2])
def test_an_unknown_payload_lowers_it_a_little(part):
    """An unknown mass dm sinks the CoM by about dm g / (m k_p): 7.4 mm for 0.94 kg."""
    payload = part * TRUNK_MASS
    run = ClosedLoop(walk(forward=0.4), payload=payload).run(4.0)
    sunk = run.after(SETTLED).error[:, 2].mean()
    assert sunk == pytest.approx(-payload * 9.81 / (12.458 * 100.0), abs=1.0 * MM)
    assert np.abs(run.tilt).max() < 0.6


def test_the_planned_forces_alone_carry_it():
    """With nu_3 = 1e2 the whole-body controller follows the MPC's forces, not its own gains."""
    wbc = dataclasses.replace(WholeBodyParameters(), defect_weight=1e2)
    run = ClosedLoop(walk(forward=0.4), wbc=wbc).run(6.0)
    reached, wanted = mean_velocity(run.after(SETTLED))
    assert np.abs(run.error[:, 2]).max() < 3.0 * MM
    assert np.abs(run.torques).max() < 20.0
    assert reached[0] == pytest.approx(wanted[0], rel=0.03)


def test_when_the_mpc_falls_silent_it_puts_its_feet_down_and_stands():
    silent = 2.05
    run = ClosedLoop(walk(), mpc_alive=lambda stamp: stamp < silent * NS_PER_S).run(4.0)
    assert run.failures == 0
    assert run.foot_forces[run.time < silent].min() == 0.0
    after = run.after(silent + 0.3)
    assert after.foot_forces.min() > 10.0
    assert np.abs(after.error).max() < 5.0 * MM
    assert np.abs(after.com_velocity[-1]).max() < 1.0 * MM


def test_the_same_run_twice_is_the_same_to_the_bit():
    first, second = (ClosedLoop(walk(forward=0.4)).run(1.5) for _ in range(2))
    np.testing.assert_array_equal(first.com, second.com)
    np.testing.assert_array_equal(first.torques, second.torques)
