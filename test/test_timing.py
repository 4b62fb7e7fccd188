"""The rule that matches inputs to ticks."""

import numpy as np
import pytest

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import PlannedMotion
from layered_cbf_ros.messages.joint_state import JointStateWriter
from layered_cbf_ros.plan_following import follow
from layered_cbf_ros.timing import Inbox, InputRules, StampGuard, TimingParameters

MS = 1_000_000


def message(stamp_ns: int, value: float = 0.0) -> bytes:
    return JointStateWriter(['a']).encode(stamp_ns, *np.full((3, 1), value))


@pytest.mark.parametrize('tick_ms', range(40))
def test_lockstep_wants_the_newest_input_that_is_old_enough(tick_ms):
    """Against a search over all stamps that a sender makes."""
    rules = InputRules(TimingParameters())
    cases = (rules.plan, 2, 1), (rules.forces, 2, 2), (rules.tracks, 10, 10), (rules.command, 1, 1)
    for rule, period, latency in cases:
        sent = [s for s in range(0, 50, period) if s <= tick_ms - latency]
        wanted = rule.wanted(tick_ms * MS)
        assert wanted == (sent[-1] * MS if sent else None)


def test_late_detections_are_waited_for_as_long_as_they_are_late():
    rules = InputRules(TimingParameters(detection_delay=0.05))
    assert rules.tracks.wanted(100 * MS) == 40 * MS
    assert rules.tracks.wanted(59 * MS) is None


def test_a_message_sent_twice_counts_once():
    inbox = Inbox()
    assert inbox.offer(message(5, 1.0))
    assert not inbox.offer(message(5, 2.0))
    assert inbox.exactly(5) == message(5, 1.0)
    assert not inbox.offer(message(5, 2.0))


def test_a_message_from_the_past_is_refused_by_name():
    inbox = Inbox()
    inbox.offer(message(2_000 * MS))
    inbox.exactly(2_000 * MS)
    with pytest.raises(MessageError, match=r'1\.500 s is 0\.500 s in the past'):
        inbox.offer(message(1_500 * MS))


def test_real_time_takes_the_newest_until_it_is_too_old():
    inbox = Inbox()
    for stamp in (1, 3, 2):
        inbox.offer(message(stamp * MS))
    assert inbox.newest(4 * MS, 50 * MS) == message(3 * MS)
    assert inbox.newest(53 * MS, 50 * MS) == message(3 * MS)
    assert inbox.newest(54 * MS, 50 * MS) is None


def test_messages_from_the_future_neither_block_nor_hide_the_present():
    """One a tick, as a bag that is replayed beside a run would send them."""
    inbox = Inbox(capacity=8)
    for tick in range(100):
        inbox.offer(message((3_600_000 + tick) * MS))
        inbox.offer(message(tick * MS))
        assert inbox.drop_after((tick + 2) * MS) == 1
        assert inbox.newest(tick * MS, 50 * MS) == message(tick * MS)


def test_a_full_inbox_keeps_the_present_in_lockstep():
    inbox = Inbox(capacity=8)
    for ahead in range(20):
        inbox.offer(message((1_000 + ahead) * MS))
    assert inbox.offer(message(5 * MS))
    assert inbox.exactly(5 * MS) == message(5 * MS)


def test_one_wrong_stamp_does_not_stop_a_clock():
    guard = StampGuard()
    assert guard.check(message(1_000 * MS)) == 1_000 * MS
    with pytest.raises(MessageError, match='future'):
        guard.check(message(3_600_000 * MS))
    assert guard.check(message(1_002 * MS)) == 1_002 * MS
    with pytest.raises(MessageError, match=r'0\.502 s in the past'):
        guard.check(message(500 * MS))
    assert guard.check(message(1_004 * MS)) == 1_004 * MS


def test_a_clock_that_really_jumps_ahead_is_believed_at_its_second_stamp():
    guard = StampGuard()
    guard.check(message(0))
    with pytest.raises(MessageError):
        guard.check(message(60_000 * MS))
    assert guard.check(message(60_002 * MS)) == 60_002 * MS


def test_an_inbox_does_not_grow():
    inbox = Inbox(capacity=4)
    for stamp in range(100):
        inbox.offer(message(stamp))
        inbox.exactly(stamp)
    assert [inbox.exactly(s) is not None for s in (98, 99)] == [False, True]


def moving(stamp_ns: int, vx: float) -> PlannedMotion:
    return PlannedMotion(stamp_ns, np.zeros(2), np.array([vx, 0.0]), np.zeros(2), 0.3, 0.5)


def test_without_a_plan_a_robot_stays_where_it_stands():
    followed = follow(None, 7, None, np.array([1.0, 2.0]), 0.4, deceleration=1.0)
    assert followed.halt
    assert followed.motion.position.tolist() == [1.0, 2.0]
    assert followed.motion.velocity.tolist() == [0.0, 0.0]


def test_when_the_plan_ends_a_robot_stops_over_its_braking_distance():
    """v^2 / 2a, and no step in position or speed at the start."""
    plan, speed = moving(0, 0.5), 0.5
    last = follow(None, 0, plan, np.zeros(2), 0.0, deceleration=2.0).last
    begin = follow(last, 1, None, np.zeros(2), 0.0, deceleration=2.0)
    assert begin.halt
    assert begin.motion.velocity[0] == pytest.approx(speed, abs=1e-8)
    end = follow(begin.last, 10_000 * MS, None, np.zeros(2), 0.0, deceleration=2.0).motion
    assert end.position[0] == pytest.approx(speed**2 / (2 * 2.0), rel=1e-12)
    assert end.velocity[0] == pytest.approx(0.0, abs=1e-12)
    assert end.acceleration[0] == 0.0


def test_braking_is_consistent_with_its_own_acceleration():
    """Position and velocity are the integrals of what is told one level up."""
    plan, dt = moving(0, 0.4), 1e-3
    for k in range(1, 600):
        before, after = plan.braked(k * MS, 1.0), plan.braked((k + 1) * MS, 1.0)
        mean = 0.5 * (before.velocity + after.velocity)
        assert after.position - before.position == pytest.approx(mean * dt, abs=1e-6)
