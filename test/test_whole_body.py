"""The whole-body controller against differences, Newton's laws and its optimum, one tick at a time.

What it does to a walking robot is told by test_locomotion.py.
"""

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest

from layered_cbf_ros.interfaces import GRAVITY, GroundForcePlan, PlannedMotion, RobotState
from layered_cbf_ros.robot_model import RobotModel, find_urdf
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.sitting import sitting_body
from layered_cbf_ros.whole_body.swing_curve import SwingCurve
from layered_cbf_ros.whole_body.torque_qp import TorqueQp
from layered_cbf_ros.whole_body.virtual_constraints import (
    BodyReference,
    FeetReference,
    VirtualConstraints,
    level_body,
)
from layered_cbf_ros.whole_body.whole_body_controller import (
    WholeBodyController,
    damping_torques,
    follow_plan,
)

PARAMETERS = WholeBodyParameters()
WEIGHT = 12.458 * GRAVITY
MS = 1_000_000
TROT = (True, False, False, True)
STAND = (True, True, True, True)


@pytest.fixture(scope='module')
def model():
    return RobotModel()


@pytest.fixture(scope='module')
def qp(model):
    return TorqueQp(PARAMETERS, model)


@pytest.fixture(scope='module')
def controller(model):
    return WholeBodyController(PARAMETERS, model)


def standing(model, stamp_ns=0):
    q = model.nominal_configuration(np.zeros(2), 0.0)
    return RobotState(stamp_ns, q, np.zeros(18), np.zeros(12), np.zeros(4))


def trotting(model, seed=0):
    """Return a state a little off the nominal pose, in motion."""
    rng = np.random.default_rng(seed)
    q = model.nominal_configuration(np.zeros(2), 0.0)
    q[7:] += 0.1 * rng.normal(size=12)
    q[3:7] += 0.05 * rng.normal(size=4)
    q[3:7] /= np.linalg.norm(q[3:7])
    return RobotState(0, q, 0.5 * rng.normal(size=18), np.zeros(12), np.zeros(4))


def still(stamp_ns=0):
    return PlannedMotion(stamp_ns, np.zeros(2), np.zeros(2), np.zeros(2), 0.0, 0.0)


def plan_of(stamp_ns, phase, rate, footholds, forces=None):
    forces = np.zeros((4, 3)) if forces is None else forces
    return GroundForcePlan(
        stamp_ns, forces, footholds, np.array(phase), np.array(rate), np.zeros(12)
    )


# --- Swing curve --------------------------------------------------------------------------------


def swing(phase, rate=5.0):
    curve = SwingCurve(0.06)
    lift_off, foothold = np.array([[0.1, 0.2, 0.03]]), np.array([[0.3, 0.1, 0.02]])
    return [x[0] for x in curve.at(lift_off, foothold, np.array([phase]), np.array([rate]))]


def test_a_swing_begins_at_lift_off_and_lands_at_rest():
    for phase, place in ((0.0, [0.1, 0.2, 0.03]), (1.0, [0.3, 0.1, 0.02])):
        position, velocity, acceleration = swing(phase)
        np.testing.assert_allclose(position, place, atol=1e-14)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
        np.testing.assert_allclose(acceleration, 0.0, atol=1e-9)


def test_a_swing_is_highest_halfway_and_never_below_its_ends():
    heights = np.array([swing(s)[0][2] for s in np.linspace(0.0, 1.0, 101)])
    assert heights[50] == pytest.approx(0.025 + 0.06, abs=1e-12)
    assert heights.max() < 0.086  # the ends' difference of 10 mm moves the top a little
    assert heights.min() >= 0.02 - 1e-12


@pytest.mark.parametrize('phase', [0.1, 0.37, 0.8])
def test_swing_velocity_and_acceleration_are_derivatives_in_time(phase):
    h, rate = 1e-5, 5.0
    ahead, here, behind = swing(phase + rate * h), swing(phase), swing(phase - rate * h)
    np.testing.assert_allclose(here[1], (ahead[0] - behind[0]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(here[2], (ahead[1] - behind[1]) / (2 * h), atol=1e-5)


# --- Swings between ticks -----------------------------------------------------------------------


def test_swings_advance_with_time_and_end_in_stance_before_an_old_plan_says_so(controller):
    feet, footholds = np.full((4, 3), 0.5), np.full((4, 3), 0.7)
    plan = plan_of(10 * MS, [0.985, 0.0, 0.0, 0.5], [5.0, 0.0, 0.0, 5.0], footholds)
    state = follow_plan(controller.start(0), 12 * MS, plan, feet)
    np.testing.assert_allclose(state.swing_phase, [0.995, 0.0, 0.0, 0.51], atol=1e-12)
    state = follow_plan(state, 13 * MS, plan, feet + 1.0)
    np.testing.assert_array_equal(state.swing_rate, [0.0, 0.0, 0.0, 5.0])
    np.testing.assert_array_equal(state.lift_off[3], feet[3])  # where it began, not where it is


def test_without_a_plan_a_swing_goes_on_and_the_foot_is_put_down(controller):
    feet = np.full((4, 3), 0.5)
    plan = plan_of(0, [0.5, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.0], feet)
    state = follow_plan(controller.start(0), 2 * MS, plan, feet)
    phases = []
    for tick in range(3, 110):
        state = follow_plan(state, tick * MS, None, feet)
        phases.append(state.swing_phase[0])
    assert phases[0] == pytest.approx(0.515, abs=1e-12)
    assert max(phases) < 1.0
    assert not state.swing_rate.any()


# --- Virtual constraints ------------------------------------------------------------------------


def test_the_level_body_moves_as_it_is_planned():
    motion = PlannedMotion(0, np.array([1.0, 2.0]), np.array([0.3, -0.4]), np.ones(2), 0.7, 0.5)
    h = 10_000  # 10 us
    here, ahead, behind = (level_body(motion.at(stamp), 0.26) for stamp in (0, h, -h))
    dt = 2e-5
    np.testing.assert_allclose((ahead.com - behind.com) / dt, here.com_velocity, atol=1e-9)
    rate = (ahead.com_velocity - behind.com_velocity) / dt
    np.testing.assert_allclose(rate, here.com_acceleration, atol=1e-9)
    spin = (ahead.rotation - behind.rotation) / dt @ here.rotation.T
    np.testing.assert_allclose(spin[1, 0], here.angular_velocity[2], atol=1e-9)
    assert here.com[2] == 0.26


def test_a_body_that_is_planned_lower_is_lower_and_moves_at_the_planned_rate():
    body = level_body(dataclasses.replace(still(), height=-0.1, vertical_velocity=-0.07), 0.26)
    assert body.com[2] == pytest.approx(0.16, abs=1e-15)
    assert body.com_velocity.tolist() == [0.0, 0.0, -0.07]


def test_a_sitting_body_moves_forwards_over_its_feet_until_its_belly_can_touch_the_ground(model):
    """Hip and toe stay farther apart than the knee folds, from standing down to the ground.

    The A1's knee folds to 2.6965 rad between links of 0.2 m; lying, the hip is 37 mm above
    the toe. Two heights say whether the velocities are the derivatives.
    """
    folded = 2.0 * 0.2 * math.cos(0.5 * 2.6965)
    feet = model.hip_offsets * (1.0, 1.0, 0.0) + (0.3, 0.2, 0.02)
    ahead, h = np.array([math.cos(0.5), math.sin(0.5)]), 1e-6

    def body(depth, rate=0.0):
        motion = dataclasses.replace(still(), yaw=0.5, height=-depth, vertical_velocity=rate)
        return sitting_body(level_body(motion, 0.26), motion, feet)

    np.testing.assert_allclose(body(0.0).com, [0.0, 0.0, 0.26], atol=1e-12)
    for depth in np.linspace(0.1, 0.2, 21):
        shift = body(depth).com[:2] - feet[:, :2].mean(axis=0)
        assert shift @ [-ahead[1], ahead[0]] == pytest.approx(0.0, abs=1e-12)
        hip = max(0.26 - 1.145 * depth, 0.037)  # above the toe, lower than it truly is
        assert math.hypot(shift @ ahead, hip) > folded
    for depth in (0.05, 0.15):
        velocity = (body(depth + h).com - body(depth - h).com) / (2.0 * h) * 0.08
        told = body(depth, -0.08).com_velocity
        assert told[2] == pytest.approx(velocity[2], abs=1e-9)
    np.testing.assert_allclose(told, velocity, atol=1e-9)


def test_orientation_converges_to_a_turning_reference_as_a_critically_damped_oscillator(model):
    """From e = e0 at rest, y'' + 20 y' + 100 y = 0 goes as e0 (1 + 10 t) exp(-10 t)."""
    constraints = VirtualConstraints(PARAMETERS)
    feet = FeetReference(np.zeros(4), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)))
    angle, spin = 0.1, np.array([0.0, 0.0, 2.0])
    q = model.nominal_configuration(np.zeros(2), 0.0)
    rotation = rotation_about(np.array([angle, 0.0, 0.0]))
    omega = rotation.T @ spin  # at rest relative to the reference
    dt, errors = 1e-3, []
    for k in range(300):
        desired = rotation_about(spin * (k * dt))
        body = BodyReference(np.zeros(3), np.zeros(3), np.zeros(3), desired, spin, np.zeros(3))
        q[3:7] = quaternion(rotation)
        velocity = np.concatenate((np.zeros(3), omega, np.zeros(12)))
        model.update(q, velocity)
        outputs = constraints.outputs(model, velocity, body, feet)
        errors.append(outputs.error[3:6])
        acceleration = outputs.acceleration[3:6]
        rotation = rotation @ rotation_about(omega * dt + 0.5 * dt * dt * acceleration)
        omega = omega + dt * acceleration
    t = dt * np.arange(300)
    expected = angle * (1.0 + 10.0 * t) * np.exp(-10.0 * t)
    # 1 ms steps err by 1 % of 0.1 rad; without feed-forward it would end at 0.04 rad.
    np.testing.assert_allclose(np.array(errors)[:, 0], expected, atol=1e-3)
    np.testing.assert_allclose(np.array(errors)[:, 1:], 0.0, atol=1e-3)


def rotation_about(vector):
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k


def quaternion(rotation):
    w = 0.5 * math.sqrt(max(0.0, 1.0 + np.trace(rotation)))
    axis = rotation - rotation.T
    return np.array([axis[2, 1], axis[0, 2], axis[1, 0], 4.0 * w * w]) / (4.0 * w)


def test_outputs_ask_for_accelerations_against_their_errors(model):
    """A body and a toe behind and below their references are to be pushed towards them."""
    constraints = VirtualConstraints(PARAMETERS)
    robot = standing(model)
    model.update(robot.configuration, robot.velocity)
    body = level_body(still(), 0.27)
    ahead = model.feet + np.array([0.01, 0.0, 0.02])
    feet = FeetReference(np.array([0.0, 1.0, 0.0, 0.0]), ahead, np.zeros((4, 3)), np.zeros((4, 3)))
    outputs = constraints.outputs(model, robot.velocity, body, feet)
    np.testing.assert_allclose(outputs.acceleration[:3], [0.0, 0.0, 1.0], atol=1e-9)
    expected = np.zeros(12)
    expected[3:6] = 400.0 * np.array([0.01, 0.0, 0.02])
    np.testing.assert_allclose(outputs.acceleration[6:], expected, atol=1e-9)


def test_outputs_obey_their_dynamics_along_any_motion(model):
    """y'' + K_d y' + K_p y = 0, with y' by central difference of y on moving references."""
    constraints = VirtualConstraints(PARAMETERS)
    robot = trotting(model)
    rng = np.random.default_rng(1)
    body_rates, toe_rates = rng.normal(size=(2, 3)), rng.normal(size=(2, 4, 3))
    spin = np.array([0.0, 0.0, 0.3])

    def at(t):
        level = np.array([0.0, 0.0, 0.25]) + t * body_rates[0]
        body = BodyReference(level, *body_rates, rotation_about(t * spin), spin, np.zeros(3))
        feet = FeetReference(np.ones(4), 0.1 + t * toe_rates[0], *toe_rates)
        q = pin.integrate(pin_model, robot.configuration, t * robot.velocity)
        model.update(q, robot.velocity)
        return constraints.outputs(model, robot.velocity, body, feet)

    pin_model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
    h = 1e-5
    rate = (at(h).error - at(-h).error) / (2 * h)
    outputs = at(0.0)
    wanted = outputs.acceleration - np.concatenate(
        (body_rates[1], np.zeros(3), toe_rates[1].ravel())
    )
    place = np.r_[0:3, 6:18]  # the orientation has a test of its own
    kp, kd = np.r_[[100.0] * 6, [400.0] * 12], np.r_[[20.0] * 6, [40.0] * 12]
    balance = wanted + kd * rate + kp * outputs.error
    np.testing.assert_allclose(balance[place], 0.0, atol=1e-5)  # 1e-7 of difference, times 40


def test_an_angular_acceleration_is_fed_forward_into_the_base_frame(model):
    constraints = VirtualConstraints(PARAMETERS)
    robot = trotting(model)
    model.update(robot.configuration, robot.velocity)
    feet = FeetReference(*np.zeros((1, 4)), *np.zeros((3, 4, 3)))
    alpha = np.array([1.0, -2.0, 3.0])
    body = level_body(still(), 0.26)
    turning = dataclasses.replace(body, angular_acceleration=alpha)
    asked = [
        constraints.outputs(model, robot.velocity, reference, feet).acceleration[3:6]
        for reference in (body, turning)
    ]
    np.testing.assert_allclose(model.rotation @ (asked[1] - asked[0]), alpha, atol=1e-12)


# --- Quadratic program --------------------------------------------------------------------------


def accelerations(model, stance, torques, forces):
    """Return what the full dynamics make of torques and forces, rows as in OutputDynamics.

    The rows of a stance foot are those of its contact point.
    """
    effort = np.concatenate((np.zeros(6), torques))
    effort += model.contact_jacobian.T @ forces.ravel() - model.bias
    qdd = np.linalg.solve(model.mass_matrix, effort)
    com = forces.sum(axis=0) / model.mass - np.array([0.0, 0.0, GRAVITY])
    toes = (model.feet_jacobian @ qdd).reshape(4, 3) + model.feet_bias
    contacts = (model.contact_jacobian @ qdd).reshape(4, 3) + model.contact_bias
    feet = np.where(np.array(stance)[:, None], contacts, toes)
    return np.concatenate((com, qdd[3:6], feet.ravel()))


@pytest.mark.parametrize('stance', [STAND, TROT, (True, True, False, True)])
@pytest.mark.parametrize('seed', [0, 1])
def test_torques_do_what_the_full_dynamics_say(model, qp, stance, seed):
    robot = trotting(model, seed)
    desired = np.random.default_rng(seed).normal(size=18)
    planted = np.repeat(stance, 3)
    desired[6:][planted] = 0.0
    model.update(robot.configuration, robot.velocity)
    solution = qp.solve(stance, desired, np.zeros((4, 3)))
    found = accelerations(model, stance, solution.torques, solution.forces)
    assert solution.solved
    # 1e-6 is the solver's tolerance; accelerations are sums of terms of size 100.
    np.testing.assert_allclose(found, desired + solution.defect, atol=1e-4)
    np.testing.assert_allclose(found[6:][planted], 0.0, atol=1e-4)  # no slip
    assert not solution.forces[~np.array(stance)].any()


def test_no_better_torques_and_forces_exist(model, qp):
    """No direction that keeps the stance feet from slipping lowers the cost."""
    robot = trotting(model)
    model.update(robot.configuration, robot.velocity)
    desired, wished = np.zeros(18), np.zeros((4, 3))
    desired[:6] = [0.5, 0.2, -0.3, 1.0, -2.0, 0.5]
    wished[[0, 3], 2] = 0.5 * WEIGHT
    solution = qp.solve(TROT, desired, wished)
    carries = np.repeat(TROT, 3)

    def cost(torques, forces):
        found = accelerations(model, TROT, torques, forces.reshape(4, 3))
        defect = (found - desired) * np.concatenate((np.ones(6), ~carries))
        off = (forces - wished.ravel())[carries]
        weights = PARAMETERS.torque_weight, PARAMETERS.force_weight, PARAMETERS.defect_weight
        squares = torques @ torques, off @ off, defect @ defect
        return 0.5 * sum(w * s for w, s in zip(weights, squares, strict=True))

    mobility = model.contact_jacobian @ model.inverse_mass_matrix
    slip = np.hstack((mobility[:, 6:], mobility @ model.contact_jacobian.T[:, carries]))[carries]
    free = np.linalg.svd(slip)[2][6:]  # 12 directions without slip
    assert solution.forces[[0, 3], 2].min() > 1.0  # inside the friction pyramids,
    assert np.abs(solution.torques).max() < 33.0  # and the torque limits
    slopes = []
    for direction in free:
        forces = np.zeros(12)
        forces[carries] = direction[12:]
        h, f = 1e-3, solution.forces.ravel()
        up = cost(solution.torques + h * direction[:12], f + h * forces)
        down = cost(solution.torques - h * direction[:12], f - h * forces)
        slopes.append((up - down) / (2 * h))
        assert up + down > 2.0 * cost(solution.torques, f)
    # The solver stops at 1e-6 of a cost scaled by 1e-4: 1e-2; one Nm of torque weighs 1e2.
    np.testing.assert_allclose(slopes, 0.0, atol=0.1)


def test_a_standing_robot_is_carried(model, controller):
    robot = standing(model)
    result = controller.step(controller.start(0), robot, still(), None)
    assert result.solved
    np.testing.assert_allclose(result.error, 0.0, atol=1e-9)
    # The defect has a finite price: 0.1 N is 8 mm/s^2, or 0.08 mm of CoM at these gains.
    np.testing.assert_allclose(result.forces.sum(axis=0), [0.0, 0.0, WEIGHT], atol=0.1)
    found = accelerations(model, STAND, result.torques, result.forces)
    np.testing.assert_allclose(found, 0.0, atol=1e-2)


@pytest.mark.parametrize('direction', [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_forces_stay_in_the_friction_pyramid_and_torques_in_their_limits(model, qp, direction):
    """Asked for 3 g sideways, the robot gives what friction and its motors can."""
    robot = standing(model)
    model.update(robot.configuration, robot.velocity)
    desired = np.zeros(18)
    desired[:2] = 3.0 * GRAVITY * np.array(direction)
    solution = qp.solve(STAND, desired, np.zeros((4, 3)))
    assert solution.solved
    assert np.abs(solution.torques).max() <= PARAMETERS.torque_limit + 1e-5
    tangent = np.abs(solution.forces[:, :2]).max(axis=1)
    slack = PARAMETERS.friction * solution.forces[:, 2] - tangent
    assert slack.min() >= -1e-5
    assert slack.min() < 1e-3  # a foot is at its limit
    assert solution.forces.sum(axis=0)[:2] @ direction > 0.3 * WEIGHT


def test_planned_forces_are_followed_where_the_motion_leaves_a_choice(model, qp):
    """Standing feet may press sideways against each other: the plan decides how much."""
    robot = standing(model)
    model.update(robot.configuration, robot.velocity)
    wished = np.zeros((4, 3))
    wished[:, 2] = 0.25 * WEIGHT
    wished[:, 1] = [5.0, -5.0, 5.0, -5.0]
    inwards = qp.solve(STAND, np.zeros(18), wished).forces[:, 1]
    outwards = qp.solve(STAND, np.zeros(18), wished * (1.0, -1.0, 1.0)).forces[:, 1]
    assert np.all((inwards - outwards) * wished[:, 1] > 0.0)


# --- When things go wrong -----------------------------------------------------------------------


@pytest.mark.parametrize('where', ['configuration', 'velocity', 'motion', 'forces', 'footholds'])
@pytest.mark.parametrize('what', [math.nan, math.inf])
def test_what_is_no_number_gives_damping_and_leaves_no_trace(model, controller, where, what):
    robot, motion = trotting(model), still()
    feet = np.tile([0.1, 0.1, 0.02], (4, 1))
    phase, rate = [0.2, 0.0, 0.0, 0.2], [5.0, 0.0, 0.0, 5.0]
    plan = plan_of(0, phase, rate, feet)
    state = controller.start(0)
    before = controller.step(state, robot, motion, plan)
    bad_robot, bad_motion, bad_plan = robot, motion, plan
    if where in ('configuration', 'velocity'):
        spoilt = getattr(robot, where).copy()
        spoilt[8] = what
        bad_robot = dataclasses.replace(robot, **{where: spoilt})
    elif where == 'motion':
        bad_motion = dataclasses.replace(motion, velocity=np.array([what, 0.0]))
    else:
        spoilt = getattr(plan, where).copy()
        spoilt[1 if where == 'forces' else 0, 2] = what
        bad_plan = dataclasses.replace(plan, **{where: spoilt})
    with np.errstate(invalid='ignore'):
        result = controller.step(state, bad_robot, bad_motion, bad_plan)
    assert not result.solved
    assert result.status == 'NOT_FINITE'
    assert result.state is state
    expected = damping_torques(bad_robot.velocity[6:], 2.0, 33.5)
    np.testing.assert_array_equal(result.torques, expected)
    again = controller.step(state, robot, motion, plan)
    np.testing.assert_allclose(again.torques, before.torques, atol=1e-3)


def test_damping_takes_energy_within_the_limits_and_survives_nonsense():
    speeds = np.array([1.0, -2.0, 100.0, -100.0, math.nan, math.inf] + 6 * [0.0])
    torques = damping_torques(speeds, 2.0, 33.5)
    expected = [-2.0, 4.0, -33.5, 33.5, 0.0, -33.5] + 6 * [0.0]
    np.testing.assert_array_equal(torques, expected)


def test_a_solver_cut_short_gives_damping(model):
    """One iteration isn't enough for a hard tick: the result says so, and is safe."""
    short = dataclasses.replace(PARAMETERS, max_iterations=1, max_inner_iterations=1)
    controller = WholeBodyController(short, model)
    robot = trotting(model)
    far = PlannedMotion(0, np.array([30.0, 0.0]), np.zeros(2), np.zeros(2), 0.0, 0.0)
    result = controller.step(controller.start(0), robot, far, None)
    assert not result.solved
    expected = damping_torques(robot.velocity[6:], 2.0, 33.5)
    np.testing.assert_array_equal(result.torques, expected)
