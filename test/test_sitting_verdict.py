"""Who sits down because he is told to hasn't fallen; who tips over, or just lies there, has."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from layered_cbf_ros.bags.audit.body_checks import HEIGHT, check_posture
from layered_cbf_ros.bags.audit.evidence import gather
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.world import motions_of
from layered_cbf_ros.bags.run.run_record import load_run
from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.bags.run.verdict import judge_record
from layered_cbf_ros.bags.storage.opening import open_bag

pytest.importorskip('rclpy', reason='rclpy, which serialises the synthetic bag, is not installed')
from synthetic_bag import Recipe, write_bag

Z, EFFORT = 2, 2
DOWN_S, UP_S = 0.4, 1.2
LYING = 0.057


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / 'bag', Recipe(period_ns=4_000_000))


@pytest.fixture
def record(bag):
    return load_run(bag)


def told_to_sit(record, robot='a1_0'):
    """Let the plan be below standing height from DOWN_S to UP_S."""
    plan = record.plan
    times = record.seconds(plan.stamps_ns)
    sits = (times >= DOWN_S) & (times < UP_S)
    plan.values[:, Z, plan.names.index(robot)] = np.where(sits, -0.2, 0.0)
    return record


def lying(record, start, end, robot='a1_0'):
    """Let a robot lie on its belly for a while."""
    motion, clearance = record.motions[robot], record.clearance
    times = record.seconds(motion.stamps_ns)
    motion.configurations[(times >= start) & (times < end), Z] = LYING
    times = record.seconds(clearance.stamps_ns)
    rows = (times >= start) & (times < end)
    clearance.values[rows, EFFORT, clearance.names.index(f'{robot}~ground')] = 90.0
    return record


def test_who_lies_as_he_is_told_has_not_fallen_and_the_stop_is_named(record):
    verdict = judge_record(lying(told_to_sit(record), 0.5, 1.1))
    assert verdict.passed, verdict.reasons
    assert (verdict.falls, verdict.e_stops) == (0, 1)
    assert verdict.e_stop_times_s == pytest.approx((DOWN_S,), abs=0.01)
    assert 'emergency stops' in verdict.table()
    assert verdict.to_json()['e_stops'] == 1


def test_without_a_stop_none_is_named(record):
    verdict = judge_record(record)
    assert (verdict.e_stops, verdict.e_stop_times_s) == (0, ())
    assert 'emergency stops' not in verdict.table()


@pytest.mark.parametrize(('start', 'end', 'first'), [(0.2, 0.5, 0.2), (1.0, 1.5, UP_S)])
def test_who_lies_when_he_should_stand_has_fallen(record, start, end, first):
    (fall,) = judge_record(lying(told_to_sit(record), start, end)).fall_events
    assert (fall.robot, fall.time_s) == ('a1_0', pytest.approx(first, abs=0.01))


def test_only_the_robot_that_is_told_may_lie(record):
    (fall,) = judge_record(lying(told_to_sit(record), 0.5, 1.1, 'a1_1')).fall_events
    assert fall.robot == 'a1_1'


def wired(record):
    """Let it be a run of robots that lie until their drivers stand them up."""
    scenario = dataclasses.replace(record.scenario, plant='emulated_a1', time='real_time')
    return dataclasses.replace(record, scenario=scenario)


def test_a_robot_with_a_driver_may_lie_until_it_stands_and_no_longer(record):
    assert judge_record(wired(lying(record, 0.0, 0.5))).falls == 0
    (fall,) = judge_record(wired(lying(record, 1.0, 1.2))).fall_events
    assert fall.time_s == pytest.approx(1.0, abs=0.01)


def test_a_robot_without_a_driver_stands_from_the_first(record):
    (fall,) = judge_record(lying(record, 0.0, 0.5)).fall_events
    assert fall.time_s == pytest.approx(0.0, abs=0.01)


def test_a_robot_that_never_stands_up_has_failed(record):
    (fall,) = judge_record(wired(lying(record, 0.0, 99.0))).fall_events
    assert fall.reason == 'it never stood up'


def test_who_tips_over_while_sitting_has_fallen(record):
    record = lying(told_to_sit(record), 0.5, 1.1)
    motion = record.motions['a1_0']
    times = record.seconds(motion.stamps_ns)
    motion.configurations[times >= 0.8, 3:7] = np.sin(0.6), 0.0, 0.0, np.cos(0.6)  # 69 degrees
    (fall,) = judge_record(record).fall_events
    assert fall.time_s == pytest.approx(0.8, abs=0.01)
    assert '60 deg' in fall.reason


def test_what_the_coordinator_was_told_dates_the_stop_before_the_sit(record):
    """Twice latched, the first time at the first tick that is told of at all."""
    stamps = record.state.stamps_ns[:40]
    latched = np.r_[np.ones(10), np.zeros(10), np.ones(20)]
    values = np.zeros((40, 4, 2))
    values[:, 3, 1] = latched
    commands = Series(('a1_0/x', 'e_stop'), stamps, values)
    verdict = judge_record(dataclasses.replace(told_to_sit(record), commands=commands))
    expected = record.seconds(stamps[[0, 20]])
    np.testing.assert_allclose(verdict.e_stop_times_s, expected, atol=1e-9)


def test_the_audit_lets_only_a_seated_robot_be_low(bag):
    evidence = gather(open_bag(bag))
    motions, plan = motions_of(evidence), evidence.traces['/safe_trajectory'].series
    low = (motions.times >= 0.5) & (motions.times < 1.1)
    motions.robots['a1_0'][low, Z] = LYING

    def height():
        checks = check_posture(evidence, motions, Limits())
        return next(check for check in checks if check.name == HEIGHT)

    (breach,) = height().breaches
    assert (breach.subject, breach.start_s) == ('a1_0', pytest.approx(0.5, abs=0.01))
    plan.values[:, Z, plan.names.index('a1_0')] = -0.2
    assert not height().breaches
