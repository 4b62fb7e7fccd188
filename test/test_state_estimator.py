"""Where the robot is, from its sensors alone: against the truth of the simulation."""

import dataclasses
import math

import numpy as np
import pytest
from closed_loop import walk
from scipy.spatial.transform import Rotation
from sensed import A1, AT_START, Sensed, again, errors, walked

from layered_cbf_ros.interfaces import GRAVITY, LEGS, TOE_RADIUS, Measured
from layered_cbf_ros.perception.contact_aided_filter import Belief, ContactAidedFilter
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.external_pose import ExternalPose
from layered_cbf_ros.perception.foot_contacts import FootContacts
from layered_cbf_ros.perception.leg_odometry import LegMotion
from layered_cbf_ros.perception.orientation import matrix, turned
from layered_cbf_ros.perception.state_estimator import StateEstimator
from layered_cbf_ros.robot_model import RobotModel

MM = 1e-3
MS = 1_000_000
SPEED = 0.5
DURATION = 4.0
STEADY = round(2.0 * 1000)
"""Tick by which the walk has its speed."""


@pytest.fixture(scope='module')
def walking():
    """A robot with the sensors of an A1 that walks a curve to the left by its estimate."""
    return walked(walk(forward=SPEED, yaw_rate=0.3), DURATION, Sensed())


def found(estimates):
    return [estimate.state for estimate in estimates]


def test_the_layers_walk_by_the_estimate(walking):
    """Required are 2 % of the way, 0.05 m/s and 10 mm; bounds are five times what is measured."""
    true = np.array([state.velocity[0] for state in walking.truth[STEADY:]])
    assert true.mean() == pytest.approx(SPEED, rel=0.02)
    wrong = errors(found(walking.estimates), walking.truth)
    assert wrong.walked > 1.4
    assert math.degrees(2.0 * math.asin(walking.truth[-1].configuration[5])) > 30.0
    assert wrong.drift < 0.002 * wrong.walked
    assert wrong.velocity.max() < 0.005
    assert wrong.height < 1.0 * MM


@pytest.mark.parametrize(
    ('field', 'spoil'),
    [
        ('joints', lambda _, joints: joints * np.array([[1.0], [-1.0], [1.0]])),
        ('angular_velocity', lambda _, rates: -rates - 0.5),
        ('specific_force', lambda _, force: force * np.array([-5.0, -5.0, 1.0])),
    ],
    ids=['joint velocities', 'turning rates', 'accelerations'],
)
def test_a_sensor_with_the_wrong_sign_is_felt(walking, field, spoil):
    """So all of them are used, and with the right sign."""
    right = errors(found(walking.estimates), walking.truth)
    wrong = errors(found(again(walking, **{field: spoil})), walking.truth)
    assert np.linalg.norm(wrong.velocity) > 2.0 * np.linalg.norm(right.velocity)


def test_the_same_measurements_give_the_same_bits(walking):
    repeated = found(again(walking))
    for first, second in zip(found(walking.estimates), repeated, strict=True):
        np.testing.assert_array_equal(first.configuration, second.configuration)
        np.testing.assert_array_equal(first.velocity, second.velocity)


def test_toes_roll(walking):
    """A stance foot's centre moves on by its radius times the turn of the lower leg.

    Oracle: the true motion of the toes' centres, by differences of forward kinematics.
    """
    model, plan = RobotModel(), walking.plans[3000]
    states = walking.truth[2998:3003]
    centres = []
    for state in states:
        model.update_kinematics(state.configuration, state.velocity)
        centres.append(model.feet.copy())
    moved = (centres[-1] - centres[0]) / 0.004
    centre, contact = model.toe_velocities(states[2].configuration, states[2].velocity)
    stands, heading = plan.in_stance, model.rotation[:, 0]
    np.testing.assert_allclose(centre[stands], moved[stands], atol=1e-3)
    assert (centre[stands] @ heading > 0.02).all()
    assert np.abs(contact[stands]).max() < 2e-3


def dense(belief: Belief):
    """Return mean (21,) and covariance (21, 21), state after state, axes within."""
    plane, vertical = belief.covariance
    axes = [np.diag(unit) for unit in np.eye(3)]
    spread = np.kron(plane, axes[0] + axes[1]) + np.kron(vertical, axes[2])
    return belief.mean.ravel(), spread


def some_belief(rng) -> Belief:
    roots = 0.1 * rng.normal(size=(2, 7, 7))
    rotation = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
    return Belief(rng.normal(size=(7, 3)), roots @ roots.transpose(0, 2, 1), rotation)


@pytest.mark.parametrize('seed', range(3))
def test_two_small_filters_are_the_textbooks_one(seed):
    """x' = F x + u, P' = F P F^T + Q; K = P H^T (H P H^T + R)^-1, with all 21 states at once."""
    rng, p = np.random.default_rng(seed), AT_START
    belief, trust, dt = some_belief(rng), rng.uniform(0.1, 1.0, 4), 0.002
    legs = LegMotion(*rng.normal(size=(3, 4, 3)))
    rotation = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
    force = rng.normal(size=3)

    one = np.eye(3)
    mean, spread = dense(belief)
    turn = np.eye(21)
    turn[6:9, 6:9] = rotation @ belief.rotation.T  # the bias belongs to the body
    mean = turn @ mean
    step = np.eye(21)
    step[:3, 3:6], step[:3, 6:9], step[3:6, 6:9] = dt * one, -0.5 * dt**2 * one, -dt * one
    push = np.zeros(21)
    acceleration = rotation @ force - [0.0, 0.0, GRAVITY]
    push[:3], push[3:6] = 0.5 * dt**2 * acceleration, dt * acceleration
    push[9:] = dt * legs.rolling.ravel()
    feet = trust * p.foot_drift**2 + (1.0 - trust)
    noise = dt * np.repeat([0.0, p.acceleration_noise**2, p.bias_drift**2, *feet], 3)
    mean, spread = step @ mean + push, step @ spread @ step.T + np.diag(noise)

    filter_ = ContactAidedFilter(p)
    predicted = filter_.predict(belief, dt, rotation, force, legs, trust)
    for mine, textbook in zip(dense(predicted), (mean, spread), strict=True):
        np.testing.assert_allclose(mine, textbook, atol=1e-12)

    rows, values, variances = [], [], []
    for leg in range(4):
        for axis in range(3):
            row = np.zeros((2, 21))
            row[0, 9 + 3 * leg + axis], row[0, axis], row[1, 3 + axis] = 1.0, -1.0, 1.0
            rows += [*row]
            values += [legs.feet[leg, axis], -legs.contact_velocity[leg, axis]]
            variances += [p.leg_noise**2, p.leg_velocity_noise**2 / trust[leg]]
        rows.append(np.eye(21)[9 + 3 * leg + 2])
        values.append(TOE_RADIUS)
        variances.append(p.ground_noise**2 / trust[leg])
    h = np.array(rows)
    gain = spread @ h.T @ np.linalg.inv(h @ spread @ h.T + np.diag(variances))
    corrected = filter_.correct(predicted, legs, trust, still=False)
    after, left = dense(corrected)
    np.testing.assert_allclose(after, mean + gain @ (np.array(values) - h @ mean), atol=1e-8)
    np.testing.assert_allclose(left, spread - gain @ h @ spread, atol=1e-8)


def test_a_corrected_heading_turns_all_that_the_body_carries():
    """Seen from the body nothing changes: not its velocity, its bias, nor where its feet are."""
    belief = some_belief(np.random.default_rng(3))
    after = ContactAidedFilter(AT_START).turn(belief, 0.2)
    change = Rotation.from_matrix(after.rotation) * Rotation.from_matrix(belief.rotation).inv()
    np.testing.assert_allclose(change.as_rotvec(), [0.0, 0.0, 0.2], atol=1e-12)
    np.testing.assert_array_equal(after.mean[0], belief.mean[0])
    carried = [
        np.vstack((b.mean[1:3], b.mean[3:] - b.mean[0])) @ b.rotation for b in (after, belief)
    ]
    np.testing.assert_allclose(*carried, atol=1e-12)


def test_the_heading_is_turned_and_not_the_tilt():
    tilted, about = Rotation.from_euler('xyz', [0.2, -0.1, 0.7]), Rotation.from_euler('z', 0.5)
    found_ = Rotation.from_quat(turned(tilted.as_quat(), 0.5))
    np.testing.assert_allclose(found_.as_matrix(), (about * tilted).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(matrix(tilted.as_quat()), tilted.as_matrix(), atol=1e-12)


@pytest.mark.parametrize(('age', 'stands'), [(5, False), (15, True)])
def test_a_plan_that_is_a_little_old_is_carried_on(walking, age, stands):
    """A swing of 0.2 s that is done but for 10 ms has landed 15 ms later."""
    contacts = FootContacts(dataclasses.replace(AT_START, contacts='schedule'))
    phase, rate = np.array([0.95, 0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0, 0.0])
    plan = dataclasses.replace(
        next(plan for plan in walking.plans if plan is not None),
        stamp_ns=0,
        swing_phase=phase,
        swing_rate=rate,
    )
    memory = contacts.start(np.zeros(4))
    _, trust = contacts.step(memory, 0.001, standing(age * MS), plan, lying=False)
    assert (trust[0] > 0.0) == stands
    assert (trust[1:] == 1.0).all()


@pytest.mark.parametrize('contacts', ['schedule', 'force', 'both'])
def test_any_source_of_contacts_will_do(walking, contacts):
    parameters = dataclasses.replace(AT_START, contacts=contacts)
    wrong = errors(found(again(walking, parameters)), walking.truth)
    assert wrong.drift < 0.004 * wrong.walked
    assert wrong.velocity.max() < 0.005


def test_schedule_needs_no_sensor_and_force_no_schedule(walking):
    deaf = dataclasses.replace(AT_START, contacts='schedule')
    blind = dataclasses.replace(AT_START, contacts='force')
    for parameters, change in (
        (deaf, {'foot_forces': lambda *_: np.zeros(4)}),
        (blind, {'plan': lambda *_: None}),
    ):
        wrong = errors(found(again(walking, parameters, **change)), walking.truth)
        assert wrong.drift < 0.004 * wrong.walked


def test_both_believe_no_foot_that_only_one_source_sees(walking):
    """A foot that comes late is in the air although its schedule says that it stands."""
    late = again(walking, foot_forces=lambda tick, forces: forces * [1.0, 1.0, 1.0, tick < 2500])
    trust = np.array([estimate.trust for estimate in late])
    assert trust[2600:, 3].max() == 0.0
    assert trust[2600:, :3].mean() > 0.3
    wrong = errors(found(late), walking.truth)
    assert wrong.drift < 0.01 * wrong.walked


def test_what_a_foot_reads_in_the_air_is_learned_in_its_swings(walking):
    """A sensor 40 units off seems to carry for ever; it drifts, and may be negative."""
    offsets = np.array([40.0, -25.0, 60.0, 0.0])
    parameters = dataclasses.replace(AT_START, contacts='force')
    estimates = again(
        walking, parameters, foot_forces=lambda tick, forces: forces + offsets + 2e-3 * tick
    )
    rest = np.array([e.memory.contacts.at_rest for e in estimates])
    true = offsets + 2e-3 * len(rest)
    np.testing.assert_allclose(rest[-1], true, atol=A1.foot_force_offset + 2.0)
    swings = np.array([plan is not None and not plan.in_stance[0] for plan in walking.plans])
    trust = np.array([e.trust[0] for e in estimates])
    assert trust[STEADY:][swings[STEADY:]].mean() < 0.1
    assert trust[STEADY:][~swings[STEADY:]].mean() > 0.7


def standing(stamp_ns: int, upper: float = 0.9, forces=30.0, yaw: float = 0.0, **changes):
    """Return what a robot at rest reads; the greater the angle [rad], the lower it stands."""
    joints = np.zeros((3, 12))
    joints[0] = np.tile([0.0, upper, -2.0 * upper], 4)
    quaternion = Rotation.from_euler('z', yaw).as_quat()
    given = {
        'orientation': quaternion,
        'angular_velocity': np.zeros(3),
        'specific_force': np.array([0.0, 0.0, GRAVITY]),
        'foot_forces': np.full(4, forces),
    }
    return Measured(stamp_ns, joints, **(given | changes))


HARDWARE = StateEstimatorParameters(start_x=1.0, start_y=-2.0, start_yaw=1.0, tare_height=0.15)


def risen(estimator, memory=None, yaw: float = 0.4, rest=12.0, poses=()):
    """Lie for 0.3 s, rise within 0.5 s and stand; yield each estimate."""
    for tick in range(1500):
        part = np.clip((tick - 300) / 500.0, 0.0, 1.0)
        load = 30.0 * (part > 0.0)
        speed = -0.45 / 0.5 * (0.0 < part < 1.0)
        measured = standing(tick * MS, 1.35 - 0.45 * part, rest + load, yaw)
        measured.joints[1] = np.tile([0.0, speed, -2.0 * speed], 4)
        estimate = estimator.step(memory, measured, None, poses if tick == 1 else ())
        memory = estimate.memory
        yield tick, estimate


def test_nothing_is_told_before_the_robot_stands():
    """It begins at the scenario's pose, whatever heading its IMU tells."""
    p, told = HARDWARE, []
    for tick, estimate in risen(StateEstimator(p)):
        told += [tick] if estimate.state is not None else []
        if tick == 299:
            np.testing.assert_allclose(estimate.memory.contacts.at_rest, 12.0)
            assert 'standing_height' in estimate.memory.waits_for
    assert 800 + 300 - 10 <= told[0] <= 800 + 300 + 10
    assert told == list(range(told[0], 1500))
    state = estimate.state
    model = RobotModel()
    model.update_kinematics(state.configuration, state.velocity)
    np.testing.assert_allclose(model.com[:2], [1.0, -2.0], atol=1e-6)
    assert math.atan2(model.rotation[1, 0], model.rotation[0, 0]) == pytest.approx(1.0)
    assert model.feet[:, 2] == pytest.approx(np.full(4, TOE_RADIUS), abs=1e-4)
    np.testing.assert_allclose(state.foot_forces, 30.0)


def test_a_robot_on_three_feet_does_not_stand_yet():
    estimator, memory = StateEstimator(HARDWARE), None
    for tick in range(600):
        forces = np.array([40.0, 40.0, 40.0, 2.0])
        estimate = estimator.step(memory, standing(tick * MS, foot_forces=forces), None)
        memory = estimate.memory
    assert estimate.state is None
    assert memory.waits_for == f'a load on {LEGS[3]}'


def test_where_motion_capture_sees_it_goes_before_the_scenario():
    seen = ExternalPose(0, np.array([1.2, -2.1, 0.06]), 0.7)
    p = dataclasses.replace(HARDWARE)
    *_, (_, forgotten) = risen(StateEstimator(p), poses=(seen,))
    assert forgotten.state.configuration[0] == pytest.approx(1.0, abs=0.05)  # it is a second old
    estimator, memory = StateEstimator(p), None
    for tick, estimate in risen(estimator):
        memory = estimate.memory
        if tick == 1000:
            break
    seen = ExternalPose(memory.stamp_ns, np.array([1.2, -2.1, 0.2]), 0.7)
    for tick in range(1001, 1300):
        estimate = estimator.step(memory, standing(tick * MS, forces=42.0, yaw=0.4), None, (seen,))
        memory, seen = estimate.memory, dataclasses.replace(seen, stamp_ns=tick * MS)
    np.testing.assert_allclose(estimate.state.configuration[:2], [1.2, -2.1], atol=1 * MM)
    turned = Rotation.from_quat(estimate.state.configuration[3:7]).as_rotvec()
    np.testing.assert_allclose(turned, [0.0, 0.0, 0.7], atol=1e-3)


def test_a_robot_that_leaves_the_ground_falls():
    """v = -g t by the accelerometer alone, forwards as it was thrown."""
    estimator, memory = StateEstimator(AT_START), None
    for tick in range(300):
        flies = tick >= 100
        thrown = np.array([2.0, 0.0, 0.0]) if 100 <= tick < 200 else np.zeros(3)
        force = thrown if flies else np.array([0.0, 0.0, GRAVITY])
        measured = standing(tick * MS, forces=0.0 if flies else 30.0, specific_force=force)
        estimate = estimator.step(memory, measured, None)
        memory = estimate.memory
        if tick == 99:
            height = estimate.state.configuration[2]
    # For a few milliseconds the smoothed readings still hold it.
    assert estimate.state.velocity[2] == pytest.approx(-GRAVITY * 0.2, rel=0.1)
    assert estimate.state.velocity[0] == pytest.approx(0.2, rel=0.1)
    assert estimate.state.configuration[2] - height == pytest.approx(-0.5 * GRAVITY * 0.04, rel=0.2)


def test_a_robot_that_lies_stays_where_it_is():
    """No foot carries; what its accelerometer reads too much must not carry it away."""
    estimator, memory = StateEstimator(AT_START), None
    for tick in range(2500):
        force = np.array([0.2, 0.0, GRAVITY])
        estimate = estimator.step(
            memory, standing(tick * MS, forces=30.0 * (tick < 50), specific_force=force), None
        )
        memory = estimate.memory
    assert np.linalg.norm(estimate.state.velocity[:3]) < 0.02
    assert np.hypot(*estimate.state.configuration[:2]) < 0.1


def test_after_a_gap_its_feet_tell_how_fast_it_is(walking):
    """Nothing was measured for 0.2 s: the estimate is right again within two steps."""
    estimator, memory, tail = StateEstimator(AT_START), None, []
    for tick, (measured, plan) in enumerate(zip(walking.measured, walking.plans, strict=True)):
        if 2500 <= tick < 2700:
            continue
        estimate = estimator.step(memory, measured, plan)
        memory = estimate.memory
        tail += [estimate.state] if tick >= 2900 else []
    wrong = errors(tail, walking.truth[2900:])
    assert wrong.velocity.max() < 0.01
    assert wrong.height < 2.0 * MM


def seen(walking, offset=(0.0, 0.0), delay=50, every=10, begin=100, yaw=0.0, rng=None):
    """Return poses of motion capture by arrival: the truth, shifted and turned, delayed [ms]."""
    poses = {}
    for tick in range(begin, len(walking.truth) - delay, every):
        pose = walking.truth[tick].configuration
        noise = np.zeros(2) if rng is None else rng.normal(0.0, 2.0 * MM, 2)
        place = np.array([*(pose[:2] + offset + noise), pose[2]])
        heading = Rotation.from_quat(pose[3:7]).as_rotvec()[2] + yaw
        poses[tick + delay] = [ExternalPose(tick * MS, place, heading)]
    return poses


def drifting(tick, orientation):
    """Return what an IMU tells whose heading drifts by 0.04 rad/s."""
    return (Rotation.from_euler('z', 4e-5 * tick) * Rotation.from_quat(orientation)).as_quat()


def test_late_poses_hold_a_heading_that_drifts(walking):
    """50 ms late, a robot is 25 mm further: taken for present, the error would be that."""
    alone = errors(found(again(walking, orientation=drifting)), walking.truth)
    assert alone.yaw == pytest.approx(4e-5 * len(walking.truth), rel=0.05)
    assert alone.drift > 0.1
    poses = seen(walking, rng=np.random.default_rng(0))
    parameters = dataclasses.replace(AT_START, yaw_drift=0.01)
    helped = again(walking, parameters, poses, orientation=drifting)
    wrong = errors(found(helped)[STEADY:], walking.truth[STEADY:])
    assert sum(len(estimate.refused) for estimate in helped) == 0
    assert wrong.drift < 10 * MM
    assert abs(wrong.yaw) < 0.02
    assert wrong.velocity.max() < 0.02


def test_one_error_is_corrected_once_however_many_poses_are_on_their_way(walking):
    """It was put 60 mm to the left: the estimate goes there, and does not overshoot."""
    poses = seen(walking, offset=(0.0, 60 * MM))
    estimates = again(walking, poses=poses)
    error = [
        e.state.configuration[1] - true.configuration[1]
        for e, true in zip(estimates, walking.truth, strict=True)
    ]
    step = np.abs(np.diff(error)).max()
    assert error[-1] == pytest.approx(60 * MM, abs=3 * MM)
    assert max(error) < 64 * MM
    assert step < AT_START.external_step + 0.2 * MM


def test_an_outlier_is_refused_and_named(walking):
    poses = seen(walking, rng=np.random.default_rng(0))
    wild = list(poses)[100:300:10]
    for k, arrival in enumerate(wild):
        pose = poses[arrival][0]
        off = np.array([(-1.0) ** k * 0.5, 0.3 * (k % 3), 0.0])
        poses[arrival] = [dataclasses.replace(pose, position=pose.position + off)]
    estimates = again(walking, poses=poses)
    refused = {tick: e.refused for tick, e in enumerate(estimates) if e.refused}
    assert sorted(refused) == wild
    assert all('off' in why for whys in refused.values() for why in whys)
    wrong = errors(found(estimates), walking.truth)
    assert wrong.drift < 10 * MM


def test_outliers_that_agree_are_believed_in_the_end(walking):
    """Motion capture was set up anew, 0.3 m to the side: that is where the robot is."""
    poses = seen(walking) | seen(walking, begin=1500, offset=(0.0, 0.3))
    estimates = again(walking, poses=poses)
    refused = [tick for tick, e in enumerate(estimates) if e.refused]
    assert len(refused) == AT_START.external_relock - 1
    error = estimates[-1].state.configuration[1] - walking.truth[-1].configuration[1]
    assert error == pytest.approx(0.3, abs=10 * MM)
    assert estimates[-1].state.velocity[1] == pytest.approx(0.0, abs=0.1)


def test_without_poses_it_goes_on_by_its_legs(walking):
    """They end after 2 s; nothing jumps, and the way from there is as good as ever."""
    poses = {tick: pose for tick, pose in seen(walking).items() if tick < 2000}
    estimates = found(again(walking, poses=poses))
    wrong = errors(estimates, walking.truth)
    assert wrong.drift < 10 * MM
    assert wrong.velocity.max() < 0.01


@pytest.mark.parametrize(('age', 'why'), [(400, 'too old'), (-200, 'future'), (50, 'not newer')])
def test_a_pose_from_another_time_is_refused(walking, age, why):
    poses = seen(walking)
    at = max(tick for tick in poses if tick < 3000)
    pose = dataclasses.replace(poses[at][0], stamp_ns=(at - age) * MS)
    if why == 'not newer':
        pose = poses[at - 10][0]
    poses[at] = [pose]
    refused = again(walking, poses=poses)[at].refused
    assert len(refused) == 1
    assert why in refused[0]


def test_noise_of_a_good_sensor_costs_what_it_must(walking):
    """Ten times the noise of the joints' speed must not shake the estimated velocity."""
    rng = np.random.default_rng(5)
    loud = 10.0 * A1.encoder_velocity_noise

    def noisier(_, joints):
        return joints + np.array([[0.0], [loud], [0.0]]) * rng.normal(size=(3, 12))

    wrong = errors(found(again(walking, joints=noisier)), walking.truth)
    # Feet 0.25 m below, two of them standing: averaged once they would be off by 0.09 m/s.
    assert wrong.velocity.max() < 0.02
