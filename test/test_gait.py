import numpy as np
import pytest

from layered_cbf_ros.ground_forces.gait import FOREVER_NS, Gait, GaitState, touch_downs
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters

MS = 1_000_000
START_NS = 5_000 * MS
TICK_NS = 2 * MS
FL, FR, RL, RR = range(4)


def stance_over(gait, state, milliseconds, after=START_NS):
    return gait.in_stance(state, after + MS * np.arange(milliseconds))


def test_robot_stands_first_then_diagonal_legs_swing_together():
    gait = Gait(GroundForceParameters(stand_time=0.2))
    stance = stance_over(gait, gait.start(START_NS), 1000)
    assert stance[:200].all()
    assert (stance[200:, FL] == stance[200:, RR]).all()
    assert (stance[200:, FR] == stance[200:, RL]).all()
    assert (stance[200:, FL] != stance[200:, FR]).all()  # duty 0.5: one pair at a time
    assert not stance[200, FL]


@pytest.mark.parametrize('duty', [0.5, 0.6, 0.75])
@pytest.mark.parametrize('period', [0.2, 0.4, 0.5])
def test_each_foot_stands_its_duty_and_a_diagonal_pair_always_carries(duty, period):
    gait = Gait(GroundForceParameters(duty=duty, gait_period=period, stand_time=0.0))
    stance = stance_over(gait, gait.start(START_NS), round(2000 * period))  # two periods
    np.testing.assert_allclose(stance.mean(axis=0), duty, atol=2e-3)  # 1 ms of 400 ms
    assert (stance[:, [FL, RR]].all(axis=1) | stance[:, [FR, RL]].all(axis=1)).all()
    assert gait.stance_time == pytest.approx(duty * period, abs=1e-9)
    assert gait.swing_time + gait.stance_time == pytest.approx(period, abs=1e-9)


def test_swing_phase_grows_at_its_rate_from_lift_off_to_landing():
    gait = Gait(GroundForceParameters(duty=0.6))
    state = gait.start(START_NS)
    for milliseconds in range(0, 1000, 7):
        stamp_ns = START_NS + milliseconds * MS
        phase, rate = gait.swing(state, stamp_ns)
        later, later_rate = gait.swing(state, stamp_ns + MS)
        in_stance = gait.in_stance(state, np.array([stamp_ns]))[0]
        np.testing.assert_array_equal(rate == 0.0, in_stance)
        assert ((phase >= 0.0) & (phase < 1.0) & ((phase == 0.0) | ~in_stance)).all()
        both = (rate > 0.0) & (later_rate > 0.0)
        np.testing.assert_allclose((later - phase)[both], 1e-3 * rate[both], atol=1e-12)
    np.testing.assert_allclose(rate[rate > 0.0], 1.0 / 0.16)


def test_halted_robot_finishes_its_swing_then_stands():
    gait = Gait(GroundForceParameters(stand_time=0.0))
    halted = gait.advance(gait.start(START_NS), START_NS + 250 * MS, stand=True)
    free, stance = stance_over(gait, gait.start(START_NS), 400), stance_over(gait, halted, 2000)
    np.testing.assert_array_equal(stance[:400], free)  # the second swing is from 200 to 400 ms
    assert stance[400:].all()


def test_halt_before_the_first_step_or_between_swings_stands_at_once():
    gait = Gait(GroundForceParameters(stand_time=0.2, duty=0.6))
    waiting = gait.advance(gait.start(START_NS), START_NS + 100 * MS, stand=True)
    assert stance_over(gait, waiting, 2000).all()
    between_ns = START_NS + (200 + 180) * MS  # the first swing ends after 160 of 200 ms
    between = gait.advance(gait.start(START_NS), between_ns, stand=True)
    assert stance_over(gait, between, 2000, between_ns).all()


@pytest.mark.parametrize('halted_ticks', [1, 50])
def test_a_halt_at_the_start_does_not_shorten_the_time_on_four_feet(halted_ticks):
    """No motion is known at the first ticks: the robot halts, then is told to walk."""
    gait = Gait(GroundForceParameters(stand_time=0.2))
    state = gait.start(START_NS)
    for tick in range(200):
        stamp_ns = START_NS + tick * TICK_NS
        state = gait.advance(state, stamp_ns, stand=tick < halted_ticks)
        stands = gait.in_stance(state, np.array([stamp_ns]))[0].all()
        assert stands == (tick * TICK_NS < 200 * MS)


@pytest.mark.parametrize('stand_time', [0.0, 0.2])
def test_a_robot_told_to_stand_never_lifts_a_foot(stand_time):
    gait = Gait(GroundForceParameters(stand_time=stand_time))
    state = gait.start(START_NS)
    for tick in [*range(5), *range(400, 600)]:  # a gap is no reason to walk either
        state = gait.advance(state, START_NS + tick * TICK_NS, stand=True)
        assert stance_over(gait, state, 500).all()


def test_withdrawn_halt_leaves_no_trace_in_mid_swing_and_starts_anew_later():
    gait = Gait(GroundForceParameters(stand_time=0.0))
    trotting = gait.start(START_NS)
    halted = gait.advance(trotting, START_NS + 250 * MS, stand=True)
    assert gait.advance(halted, START_NS + 350 * MS, stand=False) == trotting
    resumed_ns = START_NS + 777 * MS
    assert gait.advance(halted, resumed_ns, stand=False) == GaitState(resumed_ns, FOREVER_NS)


@pytest.mark.parametrize('skip', [1, 2, 7, 23])
def test_skipped_ticks_change_nothing(skip):
    gait = Gait(GroundForceParameters(duty=0.6))
    state = gait.start(START_NS)
    halt_ns = START_NS + 500 * MS  # 100 ms into a swing of 160 ms
    for stamp_ns in range(START_NS, START_NS + 900 * MS, skip * TICK_NS):
        state = gait.advance(state, stamp_ns, stand=stamp_ns >= halt_ns)
    assert state.end_ns == START_NS + 560 * MS


@pytest.mark.parametrize('velocity', [(0.5, 0.0), (-0.2, 0.3)])
@pytest.mark.parametrize('yaw_rate', [0.0, 0.8])
def test_at_mid_stance_every_hip_is_above_its_foot(velocity, yaw_rate):
    hips = np.array([[x, y, 0.0] for x in (0.18, -0.18) for y in (0.13, -0.13)])
    position, yaw, left = np.array([3.0, -1.0]), 0.4, np.array([0.05, 0.15, 0.15, 0.05])
    feet = touch_downs(
        position, np.array(velocity), np.zeros(2), yaw, yaw_rate, hips, left, 0.1, 0.02
    )
    for foot, hip, time_left in zip(feet, hips, left, strict=True):
        t = time_left + 0.1
        heading = np.exp(1j * (yaw + yaw_rate * t))  # the plane as complex numbers
        above = complex(*(position + t * np.array(velocity))) + heading * complex(*hip[:2])
        np.testing.assert_allclose(foot, [above.real, above.imag, 0.02], atol=1e-12)


def test_correction_shifts_all_feet_alike():
    hips = np.zeros((4, 3))
    shift = touch_downs(
        np.zeros(2), np.zeros(2), np.array([0.01, -0.02]), 0.3, 0.0, hips, np.zeros(4), 0.1, 0.02
    )
    np.testing.assert_allclose(shift, np.tile([0.01, -0.02, 0.02], (4, 1)), atol=1e-15)
