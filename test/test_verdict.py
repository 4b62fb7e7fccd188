"""The verdict sees in a bag what happened, and proves nothing from what isn't there."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pinocchio as pin
import pytest

from layered_cbf_ros.bags.figures.run_figures import draw, draw_record
from layered_cbf_ros.bags.run.checks import Limits
from layered_cbf_ros.bags.run.evidence import missing_evidence
from layered_cbf_ros.bags.run.measures import roll_pitch_tilt
from layered_cbf_ros.bags.run.run_record import load_run
from layered_cbf_ros.bags.run.verdict import judge, judge_record

pytest.importorskip('rclpy', reason='rclpy, which serialises the synthetic bag, is not installed')
from synthetic_bag import GOAL_X, LANE, SPEED, TOLERANCE, Recipe, SyntheticRun, write_bag

COARSE = Recipe(period_ns=4_000_000)
PERIOD = COARSE.period_ns * 1e-9


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp('walk') / 'bag', COARSE)


@pytest.fixture
def judged(tmp_path):
    """Judge the coarse walk with some changes."""

    def judge_changed(**changes):
        recipe = dataclasses.replace(COARSE, **changes)
        return judge(write_bag(tmp_path / f'bag{len(list(tmp_path.iterdir()))}', recipe))

    return judge_changed


def test_an_uneventful_walk_passes_with_the_figures_it_was_made_of(walk):
    """Every figure is known from the recipe; 1e-9 covers rounding, a period the sampling."""
    verdict = judge(walk)
    assert verdict.passed, verdict.reasons
    assert (verdict.scenario, verdict.seed, verdict.truncated) == ('synthetic', 7, False)
    assert verdict.sim_time_s == pytest.approx(COARSE.duration)
    assert verdict.real_time_factor == pytest.approx(COARSE.real_time_factor)
    assert verdict.max_plan_error_m == pytest.approx(COARSE.plan_error, abs=1e-9)
    assert verdict.max_torque_nm == COARSE.torque
    assert verdict.min_clearance_m == COARSE.clearance
    assert (verdict.max_roll_deg, verdict.max_pitch_deg) == (0.0, 0.0)
    assert (verdict.falls, verdict.contacts) == (0, 0)
    run = SyntheticRun(COARSE)
    base_ahead = run.configuration(0, 0.0)[0] - run.com(0, 0.0)[0]
    expected = (GOAL_X - TOLERANCE - base_ahead) / SPEED
    assert verdict.goal_reached_s == pytest.approx(expected, abs=PERIOD)
    assert set(verdict.goals_reached_s) == {'a1_0', 'a1_1'}


def test_smallest_distance_is_that_of_the_worst_margin(walk):
    """The obstacle's orbit and the straight walk, sampled on their own."""
    run, times = SyntheticRun(COARSE), np.arange(0.0, COARSE.duration + 1e-9, 10 * PERIOD)
    base = [run.configuration(0, t)[:2] for t in times]
    obstacle = [run.obstacle.motion.at(t)[0] for t in times]
    expected = min(math.dist(a, b) for a, b in zip(base, obstacle, strict=True))
    verdict = judge(walk)
    assert expected < LANE  # nearer than the other robot
    assert verdict.min_distance_pair == 'a1_0~obstacle_1'
    assert verdict.min_distance_m == pytest.approx(expected, abs=1e-9)
    assert verdict.promised_distance_m == pytest.approx(0.3 + 0.25)


def test_the_promise_is_that_of_the_run(walk):
    record = load_run(walk)
    scenario = dataclasses.replace(
        record.scenario, parameters={'coordinator': {'agent_radius': 0.35}}
    )
    verdict = judge_record(dataclasses.replace(record, scenario=scenario))
    assert verdict.promised_distance_m == pytest.approx(0.35 + 0.25)


def test_limits_decide(walk):
    assert not judge(walk, Limits(torque=COARSE.torque - 0.1)).passed
    assert judge(walk, Limits(torque=COARSE.torque)).passed


def test_wall_time_may_be_given(walk):
    assert judge(walk, wall_time_s=8.0).real_time_factor == pytest.approx(COARSE.duration / 8.0)


def test_a_fall_is_seen_when_it_happens(judged):
    verdict = judged(fall_at=0.4)
    (fall,) = verdict.fall_events
    assert (fall.robot, fall.time_s) == ('a1_0', pytest.approx(0.4, abs=PERIOD))
    assert verdict.max_roll_deg == pytest.approx(math.degrees(1.2), abs=1e-9)
    assert not verdict.passed
    assert any('60 deg' in reason for reason in verdict.reasons)


def test_a_body_part_on_the_ground_is_a_fall(judged):
    (fall,) = judged(scrape_at=0.8).fall_events
    assert (fall.robot, fall.time_s) == ('a1_0', pytest.approx(0.8, abs=10 * PERIOD))
    assert 'ground' in fall.reason


def test_a_contact_is_told_with_its_pair_time_and_force(judged):
    verdict = judged(touch_at=1.2)
    (contact,) = verdict.contact_events
    assert (contact.pair, contact.force_n) == ('a1_0~obstacle_1', 40.0)
    assert contact.time_s == pytest.approx(1.2, abs=10 * PERIOD)
    assert not verdict.passed


def test_bodies_inside_each_other_do_not_pass(judged):
    verdict = judged(clearance=-0.01)
    assert (verdict.min_clearance_m, verdict.passed) == (-0.01, False)


def test_a_missed_goal_does_not_pass(judged):
    verdict = judged(walks=False)
    assert verdict.goals_reached_s == {'a1_0': None, 'a1_1': None}
    assert verdict.goal_reached_s is None
    assert not verdict.passed


def test_counters_survive_a_restart_of_their_node(judged):
    """Three failures, then a restart that counts from zero: still three."""
    verdict = judged(solver_failures=3, restart_at=0.9)
    assert (verdict.solver_failures, verdict.passed) == (3, False)


@pytest.mark.parametrize(
    'topic',
    ['/scenario', '/state', '/safe_trajectory', '/simulator/clearance', '/diagnostics',
     '/obstacles/truth'],
)  # fmt: skip
def test_what_was_not_recorded_is_not_proven(judged, topic):
    verdict = judged(left_out=(topic,))
    assert not verdict.passed
    assert any(topic in reason for reason in verdict.reasons)
    assert json.dumps(verdict.to_json())
    assert 'NOT PASSED' in verdict.table()


def test_a_bag_that_was_cut_off_does_not_pass(walk, tmp_path):
    whole = (walk / 'bag_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(whole[:-20])
    verdict = judge(tmp_path / 'cut.mcap')
    assert (verdict.truncated, verdict.passed) == (True, False)
    assert verdict.trajectory_sha256 == judge(walk).trajectory_sha256


def test_the_hash_tells_one_changed_bit_and_nothing_else(judged, walk):
    """One unit in the last place of one angle counts; speed, repeats and packing don't."""
    expected = judge(walk).trajectory_sha256
    ulp = 5e-324  # of the hip angle, which is zero
    assert SyntheticRun(COARSE).configuration(0, 0.0)[7] == 0.0
    assert judged(nudge=ulp).trajectory_sha256 != expected
    same = judged(real_time_factor=0.1, repeat_every=3, compression='lz4')
    assert same.passed, same.reasons
    assert same.trajectory_sha256 == expected


@pytest.mark.parametrize('seed', range(5))
def test_roll_pitch_and_tilt_are_pinocchio_s(seed):
    """Any rotation, against Euler angles and matrix of another library."""
    quaternion = pin.Quaternion(pin.SE3.Random().rotation)
    roll, pitch, tilt = roll_pitch_tilt(quaternion.coeffs()[None] * (1.0 + 0.1 * seed))
    rotation = quaternion.normalized().matrix()
    assert (roll[0], pitch[0]) == pytest.approx(tuple(pin.rpy.matrixToRpy(rotation)[:2]), abs=1e-9)
    assert math.cos(tilt[0]) == pytest.approx(rotation[2, 2], abs=1e-9)


def test_plan_error_has_the_plan_s_side(judged):
    """The plan leads by 30 mm instead of 4: that is what is measured."""
    assert judged(plan_error=0.03).max_plan_error_m == pytest.approx(0.03, abs=1e-9)
    assert not judged(plan_error=0.11).passed


def test_the_table_tells_every_reason(judged):
    verdict = judged(fall_at=0.4, touch_at=1.0, plan_error=0.2)
    table = verdict.table()
    assert table.count('FAIL') >= 4
    assert all(reason in table for reason in verdict.reasons)
    assert set(verdict.to_json()) >= {'bag', 'passed', 'reasons', 'falls', 'contacts'}


def test_every_figure_is_drawn_and_small(walk, tmp_path):
    names = {'trajectories', 'distances', 'barriers', 'speeds', 'torques', 'intervention'}
    names.add('solve_times')
    drawn = draw(walk, tmp_path / 'figures')
    assert {path.stem for path in drawn} == names
    for path in drawn:
        data = path.read_bytes()
        assert data.startswith(b'\x89PNG')
        assert 5_000 < len(data) < 150_000


def test_figures_of_an_empty_bag_are_none(tmp_path):
    left_out = ('/state', '/scenario', '/coordinator/barriers', '/coordinator/intervention')
    bag = write_bag(tmp_path / 'bag', dataclasses.replace(COARSE, duration=0.1, left_out=left_out))
    assert draw(bag, tmp_path / 'figures') == []


def test_lost_states_are_counted(tmp_path):
    """A recorder that drops is not a proof: the gap is told."""
    record = load_run(write_bag(tmp_path / 'bag', dataclasses.replace(COARSE, duration=0.2)))
    kept = np.delete(np.arange(len(record.state.stamps_ns)), [10, 11, 30])
    state = dataclasses.replace(
        record.state, stamps_ns=record.state.stamps_ns[kept], values=record.state.values[kept]
    )
    reasons = missing_evidence(dataclasses.replace(record, state=state))
    assert any(reason.startswith('3 messages of /state') for reason in reasons)


@pytest.mark.parametrize('rows', [slice(20, None), slice(None)])
def test_a_state_that_is_not_finite_is_no_proof_and_no_crash(tmp_path, rows):
    record = load_run(write_bag(tmp_path / 'bag', dataclasses.replace(COARSE, duration=0.2)))
    record.state.values[rows] = np.nan
    for motion in record.motions.values():
        motion.configurations[rows] = motion.torques[rows] = np.nan
    verdict = judge_record(record)
    assert not verdict.passed
    assert any('not finite' in reason for reason in verdict.reasons)
    json.dumps(verdict.to_json(), allow_nan=False)
    assert len(draw_record(record, tmp_path / 'figures')) == 6
