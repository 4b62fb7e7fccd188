"""The audit finds exactly what was planted into the bag of a real run, and nothing else."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('rclpy')

from audit_planting import (
    again,
    assign,
    at,
    edited,
    edited_tick,
    read,
    set_state,
    swapped,
    without,
    write,
)
from live_run import LiveRun, wait_until_gone

from layered_cbf_ros.bags.audit.audit import audit
from layered_cbf_ros.bags.audit.body_geometry import BodyGeometry
from layered_cbf_ros.bags.audit.clearance import exact_distance
from layered_cbf_ros.bags.audit.evidence import gather
from layered_cbf_ros.bags.audit.findings import BREACH, NOT_PROVEN, OK
from layered_cbf_ros.bags.audit.limits import Limits, limits_from
from layered_cbf_ros.bags.audit.report import json_of, text_of
from layered_cbf_ros.bags.audit.surfaces import Cylinder, HalfSpace, RobotBody
from layered_cbf_ros.bags.audit.world import motions_of
from layered_cbf_ros.bags.storage.opening import open_bag

pytestmark = pytest.mark.lockstep

SCENARIO = """
description: Two A1 that meet, an obstacle that comes, and a wall; as long as a few steps.
duration: 0.8
robots:
  - {name: a1_0, position: [0.0, 0.0], desired: {goal: [5.0, 0.0]}}
  - {name: a1_1, position: [2.2, 0.2], yaw: 3.1, desired: {goal: [-4.0, 0.0]}}
obstacles:
  - name: pillar
    radius: 0.25
    motion: {line: {start: [1.0, 2.4], end: [1.0, 1.0], speed: 0.4}}
walls:
  - {name: wall_right, point: [0.0, -1.2], normal: [0.0, 1.0]}
"""
PLAN, BARRIERS, DESIRED = '/safe_trajectory', '/coordinator/barriers', '/coordinator/desired'
COMMANDS, FORCES = '/a1_0/joint_commands', '/a1_0/ground_forces'
MU, RADIUS = 0.6, 0.3  # params/ground_force_mpc.yaml, coordinator.yaml
SWING_MS, SWINGS, STANDS = 300, 'FL', 'FR'  # in the first swing of the trot


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """The folder of a run, recorded by the whole node graph."""
    folder = tmp_path_factory.mktemp('audit')
    (folder / 'meeting.yaml').write_text(SCENARIO)
    live = LiveRun(folder / 'meeting.yaml', folder / 'run')
    try:
        live.until_running()
        live.end()
    finally:
        live.process.kill()
        live.process.wait()
        wait_until_gone(live.children.values())
    return folder / 'run'


@pytest.fixture(scope='module')
def entries(run):
    return read(run / 'bag')


@pytest.fixture
def plant(entries, tmp_path):
    """Audit the bag with some changes."""

    def audit_changed(*changes, limits=None, notes=None):
        planted = list(entries)
        for change in changes:
            planted = change(planted)
        return audit(
            write(tmp_path / f'bag{len(list(tmp_path.iterdir()))}', planted, notes), limits
        )

    return audit_changed


def broken(found):
    """Return the breaches, by check; there must be no hole."""
    assert not [hole for check in found.checks for hole in check.holes]
    return {check.name: check.breaches for check in found.checks if check.breaches}


def only_breach(found, name):
    breaches = broken(found)
    assert list(breaches) == [name]
    (breach,) = breaches[name]
    return breach


def holes(found):
    assert (found.status, found.exit_code) == (NOT_PROVEN, 2)
    return [hole for check in found.checks for hole in check.holes]


def test_a_run_that_kept_its_promises_is_proven(run, plant):
    for found in (audit(run), plant()):
        assert (found.status, found.exit_code, broken(found)) == (OK, 0, {})
        assert found.duration_s == pytest.approx(0.8)
        assert 'PROVEN: every promise' in text_of(found, quiet=True)


@pytest.mark.parametrize(
    ('entry', 'field', 'value', 'check', 'told'),
    [
        ('FL_hip_joint', 'effort', 33.6, 'measured torque', 33.6),
        ('RR_lower_joint', 'effort', -50.0, 'measured torque', 50.0),
        ('FL_lower_joint', 'position', -0.90, 'joint angle beyond range', -0.9 + 0.916297857),
        ('FR_upper_joint', 'position', -1.06, 'joint angle beyond range', 1.06 - 1.0471975512),
        ('RL_upper_joint', 'velocity', 21.5, 'joint speed', 21.5),
        ('RL_upper_joint', 'velocity', -25.0, 'joint speed', 25.0),
        ('base_z', 'position', 0.1, 'trunk height', 0.1),
    ],
)
def test_each_limit_of_a_state_is_kept_by_every_sample(plant, entry, field, value, check, told):
    """The ranges of the joints are those that the maker of the A1 publishes."""
    breach = only_breach(
        plant(edited('/state', 501, set_state(f'a1_1/{entry}', field, value))), check
    )
    assert breach.subject.startswith('a1_1')
    assert (breach.start_s, breach.end_s, breach.samples) == (0.501, 0.501, 1)
    assert breach.value == pytest.approx(told, abs=1e-8)


@pytest.mark.parametrize('angle', [0.6, -0.6])
@pytest.mark.parametrize(('axis', 'check'), [('qx', 'roll'), ('qy', 'pitch')])
def test_roll_and_pitch_are_seen_to_both_sides(plant, angle, axis, check):
    def tilt(message):
        for part, value in (('qx', 0.0), ('qy', 0.0), ('qz', 0.0), ('qw', math.cos(angle / 2))):
            set_state(f'a1_0/base_{part}', 'position', value)(message)
        set_state(f'a1_0/base_{axis}', 'position', math.sin(angle / 2))(message)

    breach = only_breach(plant(edited('/state', 401, tilt)), check)
    assert (breach.subject, breach.start_s) == ('a1_0', 0.401)
    assert breach.value == pytest.approx(math.degrees(0.6), abs=1e-6)


def test_samples_in_a_row_are_one_interval_with_its_worst_value(plant):
    values = {300: 34.0, 301: 36.0, 302: -35.0, 310: 34.5}
    changes = [
        edited('/state', t, set_state('a1_0/FL_hip_joint', 'effort', v)) for t, v in values.items()
    ]
    first, second = broken(plant(*changes))['measured torque']
    assert (first.start_s, first.end_s, first.value, first.samples) == (0.3, 0.302, 36.0, 3)
    assert (second.start_s, second.end_s, second.value, second.samples) == (0.31, 0.31, 34.5, 1)


def test_commanded_torque_is_limited_too(plant):
    breach = only_breach(
        plant(edited(COMMANDS, 200, set_state('RR_hip_joint', 'effort', -33.6))), 'commanded torque'
    )
    assert (breach.subject, breach.start_s, breach.value) == ('a1_0/RR_hip_joint', 0.2, 33.6)


def test_robots_too_near_each_other_are_seen_at_one_sample(plant):
    """One robot is put beside the other for a millisecond: 0.3 m from centre to centre."""

    def beside(message):
        place = {axis: message.position[message.name.index(f'a1_0/base_{axis}')] for axis in 'xy'}
        set_state('a1_1/base_x', 'position', place['x'])(message)
        set_state('a1_1/base_y', 'position', place['y'] + 0.3)(message)

    breaches = broken(plant(edited('/state', 601, beside)))
    assert set(breaches) == {'centre distance', 'clearance'}
    (distance,), (clearance,) = breaches['centre distance'], breaches['clearance']
    assert (distance.subject, distance.start_s, distance.samples) == ('a1_0~a1_1', 0.601, 1)
    assert distance.value == pytest.approx(0.3, abs=1e-12)
    assert distance.limit == pytest.approx(2.0 * RADIUS - Limits().distance_slip)
    assert (clearance.subject, clearance.start_s) == ('a1_0~a1_1', 0.601)
    assert -0.2 < clearance.value < 0.0


def test_a_wall_and_an_obstacle_are_kept_away_from(plant):
    near_wall = edited('/state', 601, set_state('a1_0/base_y', 'position', -1.2 + 0.25))
    breach = only_breach(plant(near_wall), 'centre distance')
    assert (breach.subject, breach.start_s) == ('a1_0~wall_right', 0.601)
    assert breach.value == pytest.approx(0.25, abs=1e-12)

    def come(message):
        message.poses[0].position.x, message.poses[0].position.y = 0.0, 0.5

    breach = only_breach(plant(edited('/obstacles/truth', 400, come)), 'centre distance')
    assert breach.subject == 'a1_0~pillar'
    assert 0.391 <= breach.start_s <= 0.4 <= breach.end_s <= 0.409  # between the next truths


def test_a_plan_that_its_robot_does_not_follow_is_seen(plant):
    def leave(message):
        index = message.name.index('a1_0/base_y')
        assign(message, 'position', index, message.position[index] + 0.15)

    breach = only_breach(plant(edited('/state', 500, leave)), 'plan error')
    assert (breach.subject, breach.start_s) == ('a1_0', 0.5)
    assert breach.value == pytest.approx(0.15, abs=0.01)  # the robot was a few mm off already
    assert only_breach(
        plant(edited('/state', 300, leave), limits=limits_from(['plan_error=0.12'])), 'plan error'
    )
    assert (
        plant(edited('/state', 300, leave), limits=limits_from(['plan_error=0.2'])).exit_code == 0
    )


def set_psi(field, label, change):
    def edit(point, names):
        index = names.index(label)
        assign(point, field, index, change(getattr(point, field)[index]))

    return edit


@pytest.mark.parametrize('label', ['a1_0~a1_1', 'a1_1~obstacle_1', 'a1_0~wall_right'])
@pytest.mark.parametrize(('field', 'k'), [('positions', 0), ('velocities', 1)])
def test_psi_that_was_told_wrong_is_seen_at_its_tick(plant, label, field, k):
    """By a millimetre up or down, or with its sign turned; at odd ticks and even ones."""
    for at_ms, change in ((407, lambda v: v + 1e-3), (408, lambda v: v - 1e-3)):
        found = plant(edited_tick(BARRIERS, at_ms, set_psi(field, label, change)))
        breach = only_breach(found, f'psi{k} difference')
        assert (breach.subject, breach.start_s) == (label, at_ms / 1000)
        assert breach.value == pytest.approx(1e-3, rel=0.05)
    turned = broken(plant(edited_tick(BARRIERS, 409, set_psi(field, label, lambda v: -v))))
    assert set(turned) == {f'psi{k} published', f'psi{k} difference'}
    assert turned[f'psi{k} published'][0].value < 0.0


def test_psi_follows_from_exactly_the_track_that_a_tick_uses(plant):
    """A track with its velocity turned round acts one period later, for one period."""

    def turn(message):
        message.twist.twist.linear.y *= -1.0

    breaches = broken(plant(edited('/obstacles/tracks', 600, turn)))
    assert set(breaches) == {'psi0 difference', 'psi1 difference'} or set(breaches) == {
        'psi1 difference'
    }
    for breach in breaches['psi1 difference']:
        assert breach.subject.endswith('~obstacle_1')
        assert (breach.start_s, breach.end_s) == (pytest.approx(0.61), pytest.approx(0.619))


def test_psi_follows_from_what_the_robots_were_asked_for(plant):
    """A wish for three times the speed reaches farther; at its tick alone."""
    breaches = broken(
        plant(edited_tick(DESIRED, 600, set_psi('velocities', 'a1_0/x', lambda v: 3.0 * v)))
    )
    assert set(breaches) == {'psi0 difference', 'psi1 difference'}
    for found in breaches.values():
        (breach,) = [breach for breach in found if breach.subject == 'a1_0~a1_1']
        assert (breach.start_s, breach.end_s) == (0.6, 0.6)


def test_an_input_that_was_not_applied_is_seen_in_the_plan(plant):
    """1 mm/s^2 over a millisecond: a micrometre a second, seen at the next plan."""
    change = edited_tick(DESIRED, 601, set_psi('positions', 'a1_1/y', lambda u: u - 1e-3))
    breach = only_breach(plant(change), 'plan is its integral')
    assert (breach.subject, breach.start_s) == ('a1_1', pytest.approx(0.602))
    assert breach.value == pytest.approx(1e-6)


def set_plan(part, attribute, index, change):
    def edit(message):
        vector = getattr(message.points[0], part)[index]
        vector = getattr(vector, 'translation', None) or vector.linear
        setattr(vector, attribute, change(getattr(vector, attribute)))

    return edit


@pytest.mark.parametrize(
    ('edit', 'checks', 'value'),
    [
        (set_plan('transforms', 'y', 1, lambda v: v + 1e-3),
         {'plan is its integral', 'psi0 difference', 'psi1 difference'}, 1e-3),
        (set_plan('accelerations', 'x', 0, lambda v: 1.6),
         {'plan is its integral', 'planned acceleration'}, 1.6),
        (set_plan('velocities', 'x', 0, lambda v: -0.65),
         {'plan is its integral', 'planned speed', 'psi0 difference', 'psi1 difference'}, 0.65),
    ],
)  # fmt: skip
def test_a_plan_must_be_the_integral_of_its_inputs_within_its_limits(plant, edit, checks, value):
    breaches = broken(plant(edited(PLAN, 400, edit)))
    assert set(breaches) == checks
    told = {
        name: breach.value for name, (breach, *_) in breaches.items() if not name.startswith('psi')
    }
    assert value == pytest.approx(told[max(told)], rel=1e-3)
    assert all(breach.start_s >= 0.4 for found in breaches.values() for breach in found)


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('axis', ['x', 'y'])
def test_planned_forces_stay_in_the_friction_pyramid(plant, axis, sign):
    def slip(message):
        z = message.effort[message.name.index(f'{STANDS}_foot_z')]
        set_state(f'{STANDS}_foot_{axis}', 'effort', sign * (MU * z + 0.5))(message)

    breach = only_breach(plant(edited(FORCES, SWING_MS, slip)), 'force beyond friction cone')
    assert (breach.subject, breach.start_s) == (f'a1_0/{STANDS}_foot', 0.3)
    assert breach.value == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize(
    ('leg', 'axis', 'force', 'check'),
    [
        (STANDS, 'z', 251.0, 'largest normal force'),
        (SWINGS, 'y', -0.01, 'swing foot force'),
        (SWINGS, 'z', 5.0, 'swing foot force'),
    ],
)
def test_feet_push_as_they_may_and_not_in_the_air(plant, leg, axis, force, check):
    edit = set_state(f'{leg}_foot_{axis}', 'effort', force)
    breach = only_breach(plant(edited(FORCES, SWING_MS, edit)), check)
    assert (breach.start_s, breach.value) == (0.3, abs(force))


def test_a_foot_never_pulls(plant):
    edit = set_state(f'{STANDS}_foot_z', 'effort', -3.0)
    breaches = broken(plant(edited(FORCES, SWING_MS, edit)))
    assert breaches['least normal force'][0].value == -3.0


def test_what_is_sent_again_must_be_the_same(plant):
    found = plant(again('/state', 300), again(COMMANDS, 400))
    assert (found.exit_code, broken(found)) == (0, {})
    notes = [note for check in found.checks for note in check.notes if 'sent again' in note]
    assert len(notes) == 2
    other = set_state('FL_hip_joint', 'effort', 1.0)
    breach = only_breach(plant(again(COMMANDS, 400, other)), 'stamp with two contents')
    assert (breach.subject, breach.start_s) == (COMMANDS, 0.4)


def test_messages_in_wrong_order_are_seen(plant):
    breach = only_breach(plant(swapped(COMMANDS, 400, 403)), 'message after a later one')
    assert breach.subject == COMMANDS


def test_a_breach_beside_a_hole_is_a_breach_and_both_are_told(plant):
    found = plant(
        without(COMMANDS, 400), edited('/state', 300, set_state('a1_0/base_z', 'position', 0.1))
    )
    assert (found.status, found.exit_code) == (BREACH, 1)
    text = text_of(found, quiet=True)
    assert 'trunk height: 0.300 s, a1_0: 0.1 m' in text
    assert 'NOT PROVEN' in text
    assert json_of(found)['exit_code'] == 1


@pytest.mark.parametrize(
    ('topic', 'at_ms'),
    [('/state', 601), (COMMANDS, 500), ('/a1_1/joint_commands', 798), (PLAN, 300), (FORCES, 400),
     ('/obstacles/truth', 200), ('/obstacles/detections', 300), ('/obstacles/tracked', 300),
     ('/obstacles/tracks', 300)],
)  # fmt: skip
def test_a_message_that_is_missing_is_a_hole(plant, topic, at_ms):
    """Nothing else says that the robots were unsafe, and nothing says that they were safe."""
    told = holes(plant(without(topic, at_ms)))
    if topic != '/obstacles/tracks':
        assert f'{topic}: the message of {at_ms / 1000:.3f} s is missing' in told
    else:
        assert '1 tracks that were announced are missing, first at 0.300 s' in told


def test_a_hole_in_what_the_coordinator_tells_is_a_hole(entries, plant):
    batch = [e for e in entries if e.topic == BARRIERS][4]
    first = batch.stamp_ns() / 1e9
    told = holes(plant(without(BARRIERS, batch.stamp_ns() // 1_000_000)))
    assert any(f'messages between {first:.3f} and' in hole for hole in told)
    assert any('lacks a1_0~a1_1 at 20 stamps' in hole for hole in told)


@pytest.mark.parametrize(
    'topic',
    ['/state', '/scenario', '/diagnostics', PLAN, BARRIERS, DESIRED, COMMANDS, FORCES,
     '/obstacles/truth', '/obstacles/tracks', '/obstacles/tracked'],
)  # fmt: skip
def test_a_topic_that_was_left_out_is_a_hole(plant, topic):
    found = plant(without(topic))
    assert any(topic.rpartition('/')[2] in hole for hole in holes(found))
    json.dumps(json_of(found), allow_nan=False)
    assert 'NOT PROVEN' in text_of(found, quiet=False)


def test_a_bag_of_before_the_wishes_were_recorded_proves_all_but_psi(plant):
    found = plant(without(DESIRED))
    unproven = {check.name for check in found.checks if check.status == NOT_PROVEN}
    psi = {f'psi{k} {what}' for what in ('recomputed', 'difference') for k in range(2)}
    assert unproven == psi | {'plan is its integral', 'missing messages'}


def test_a_bag_that_is_cut_off_is_not_proven(entries, tmp_path):
    whole = write(tmp_path / 'bag', entries)
    (path,) = whole.glob('*.mcap')
    path.write_bytes(path.read_bytes()[:-30])
    assert any('cut off' in hole for hole in holes(audit(whole)))


def test_what_metadata_counts_must_be_there(run, entries, tmp_path):
    """Someone cut out what he did not like, of a topic without stamps, and left the count."""
    folder = write(tmp_path / 'bag', [e for e in entries if e.topic != '/diagnostics'])
    shutil.copy(run / 'bag' / 'metadata.yaml', folder)
    assert any('/diagnostics: metadata.yaml counts' in hole for hole in holes(audit(folder)))


def test_losses_that_the_recorder_tells_are_holes(plant):
    lost = {'recorder': {'/state': 'received=801 lost=2', '/a1_0/imu': 'received=40 lost=7'}}
    told = holes(plant(notes=lost))
    assert told == ['/state: the recorder tells of 2 lost messages']
    failed = {'recorder_failed': {'reason': 'No space left on device'}}
    assert holes(plant(notes=failed)) == ['the recorder failed: No space left on device']


def test_a_scenario_without_all_parameters_proves_nothing_that_needs_them(entries, plant):
    def forget(changed):
        (entry,) = [e for e in changed if e.topic == '/scenario']
        message = entry.message()
        scenario = json.loads(message.data)
        del scenario['parameters']['coordinator']['alpha1']
        message.data = json.dumps(scenario)
        return [entry.with_message(message) if e is entry else e for e in changed]

    assert any('parameters.coordinator.alpha1' in hole for hole in holes(plant(forget)))


def test_spoilt_messages_and_numbers_are_holes(plant):
    nan = edited('/state', 500, set_state('a1_0/base_x', 'position', math.nan))
    assert any('not finite' in hole for hole in holes(plant(nan)))

    def cut(changed):
        entry = at(changed, PLAN, 400)
        short = dataclasses.replace(entry, data=entry.data[:-60])
        return [short if e is entry else e for e in changed]

    assert any('cannot be decoded' in hole for hole in holes(plant(cut)))


def in_real_time(changed):
    """Turn the run into one in real time: each message leaves half a millisecond later."""
    planted = []
    for entry in changed:
        if entry.topic == '/scenario':
            message = entry.message()
            message.data = message.data.replace('"time": "lockstep"', '"time": "real_time"')
            planted.append(entry.with_message(message))
        elif entry.topic.startswith(('/state', PLAN, '/a1_', '/obstacles')):
            sent_ns = 10**18 + entry.stamp_ns() + (entry.topic != '/state') * 500_000
            times = {'sent_ns': sent_ns, 'log_ns': sent_ns + 100_000}
            planted.append(dataclasses.replace(entry, **times))
        else:
            planted.append(entry)
    return planted


def test_in_real_time_ages_count_and_gaps_are_told_not_judged(plant):
    """A command of t leaves at t + 0.5 ms, so that at t + 1 ms it is 1 ms old."""
    found = plant(in_real_time)
    assert (found.exit_code, broken(found)) == (0, {})
    ages = {check.name: check.worst.value for check in found.checks if check.name.endswith(' age')}
    assert ages == pytest.approx({'command age': 1e-3, 'plan age': 2e-3, 'forces age': 2e-3})
    few = plant(without(COMMANDS, *range(400, 410)), in_real_time)
    assert (few.exit_code, broken(few)) == (0, {})
    breach = only_breach(plant(without(COMMANDS, *range(400, 430)), in_real_time), 'command age')
    assert breach.subject == COMMANDS
    assert (breach.start_s, breach.end_s) == (0.42, 0.43)  # 0.399 s is older than 20 ms
    assert breach.value == pytest.approx(0.031)


def test_in_real_time_a_late_message_is_jitter_and_a_lost_state_a_hole(plant):
    def delay(changed):
        late = at(changed, PLAN, 400)
        there = dataclasses.replace(late, log_ns=late.log_ns + 150_000_000)
        return [there if entry is late else entry for entry in changed]

    breach = only_breach(plant(in_real_time, delay), 'jitter of log time')
    assert (breach.subject, breach.value) == (PLAN, pytest.approx(0.15))
    assert (breach.start_s, breach.end_s) == (0.4, pytest.approx(0.402))  # late, and then soon
    lost = holes(plant(in_real_time, without('/state', 500)))
    assert '/state: the message of 0.500 s is missing' in lost
    late = holes(plant(in_real_time, without('/state', *range(20))))
    assert any('before the first state' in hole for hole in late)


def test_clearance_agrees_with_another_geometry_engine(run):
    """Bullet measured during the run; below `exact_within` both are exact.

    1.5 mm: Bullet rounds edges by its collision margin of 1 mm.
    """
    bag = open_bag(run / 'bag')
    evidence = gather(bag)
    motions, geometry = motions_of(evidence), BodyGeometry()
    bodies = {
        name: RobotBody(geometry, q, np.full(len(q), 1.0)) for name, q in motions.robots.items()
    }
    pillar = evidence.scenario.obstacles[0]
    others = {'a1_1': bodies['a1_1'], 'pillar': Cylinder(pillar, motions.obstacles['pillar']),
              'wall_right': HalfSpace(evidence.scenario.walls[0])}  # fmt: skip
    compared = 0
    for _, message in bag.messages(['/simulator/clearance']):
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        row = int(np.searchsorted(motions.stamps_ns, stamp_ns))
        for label, distance in zip(message.name, message.position, strict=True):
            one, _, other = label.partition('~')
            if other in others and distance < 2.0:
                exact = exact_distance(bodies[one], others[other], row)
                assert exact == pytest.approx(distance, abs=1.5e-3), (label, row)
                compared += 1
    assert compared > 200


def program(*arguments):
    code = 'from layered_cbf_ros.nodes.audit import main; main()'
    return subprocess.run(
        [sys.executable, '-c', code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_program_tells_a_table_json_and_the_exit_code(run, tmp_path):
    ended = program(run, '--json', tmp_path / 'audit.json')
    assert (ended.returncode, ended.stderr) == (0, '')
    for word in ('psi0 difference', 'a1_0~a1_1', 'distance_slip', 'PROVEN'):
        assert word in ended.stdout
    found = json.loads((tmp_path / 'audit.json').read_text())
    assert (found['status'], found['exit_code']) == (OK, 0)
    assert found['limits']['torque'] == 33.5
    again_ended = program(run, '--json', tmp_path / 'audit.json')
    assert again_ended.returncode == 2
    assert 'exists already' in again_ended.stderr.splitlines()[0]
    tight = program(run, '--limit', 'torque=1', '--quiet', '--json')
    assert tight.returncode == 1
    checks = {check['name']: check for check in json.loads(tight.stdout)['checks']}
    assert len(checks['commanded torque']['breaches']) >= 1


@pytest.mark.parametrize('limit', ['torque', 'torque=strong', 'torque=nan', 'speed=3'])
def test_a_limit_that_is_none_is_named(tmp_path, limit):
    ended = program(tmp_path, '--limit', limit)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert limit in line
