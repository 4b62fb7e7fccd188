import dataclasses

import numpy as np
import pytest

from layered_cbf_ros.ground_forces.condensed_qp import CondensedQp, Cost, force_pyramid
from layered_cbf_ros.ground_forces.ground_force_mpc import (
    GroundForceMpc,
    MpcStatus,
    static_forces,
)
from layered_cbf_ros.ground_forces.mpc_inputs import MpcInputs
from layered_cbf_ros.ground_forces.parameters import PAPER_STATE_WEIGHTS, GroundForceParameters
from layered_cbf_ros.ground_forces.single_rigid_body import (
    AffineModel,
    RigidBody,
    exp_rotation,
)
from layered_cbf_ros.interfaces import PlannedMotion

BODY = RigidBody(
    12.458,
    np.diag([0.155, 0.397, 0.418]),
    np.array([[x, y, 0.0] for x in (0.183, -0.183) for y in (0.132, -0.132)]),
)
WEIGHT = 12.458 * 9.81
HEIGHT = 0.26
TICK_NS = 2_000_000
STANDING = PlannedMotion(0, np.zeros(2), np.zeros(2), np.zeros(2), 0.0, 0.0)


def standing_inputs(**changes):
    feet = BODY.hip_offsets + np.array([0.0, 0.0, 0.02])
    still = MpcInputs(
        0, np.array([0.0, 0.0, HEIGHT]), np.zeros(3), np.eye(3), np.zeros(3), feet, STANDING, HEIGHT
    )
    return dataclasses.replace(still, **changes)


def one_step(inputs, **parameters):
    mpc = GroundForceMpc(GroundForceParameters(**parameters), BODY)
    return mpc.step(mpc.start(inputs.stamp_ns), inputs)


class FreeBody:
    """The nonlinear single rigid body under forces at its feet, in world coordinates.

    It integrates linear and angular momentum, so it shares no formula with the MPC.
    """

    def __init__(self):
        self.position, self.velocity = np.array([0.0, 0.0, HEIGHT]), np.zeros(3)
        self.rotation, self.momentum = np.eye(3), np.zeros(3)
        self.feet = BODY.hip_offsets + np.array([0.0, 0.0, 0.02])

    @property
    def spin(self):
        """Angular velocity in the base frame."""
        return np.linalg.solve(BODY.inertia, self.rotation.T @ self.momentum)

    def push(self, forces, dt):
        acceleration = forces.sum(axis=0) / BODY.mass - [0.0, 0.0, 9.81]
        self.momentum = self.momentum + dt * np.cross(self.feet - self.position, forces).sum(axis=0)
        self.rotation = self.rotation @ exp_rotation(dt * self.spin)
        self.position = self.position + dt * self.velocity + 0.5 * dt * dt * acceleration
        self.velocity = self.velocity + dt * acceleration


def walk(duration, velocity, yaw_rate=0.0, halt_at=np.inf, **parameters):
    """Close the loop of MPC and free body; a swing foot is set down where it is told to.

    Returns rows (time, position, velocity, planned position, yaw error, tilt), the
    last result and the number of ticks that were not solved.
    """
    mpc = GroundForceMpc(GroundForceParameters(**parameters), BODY)
    state, body, rows, failures = mpc.start(0), FreeBody(), [], 0
    position, speed, yaw, dt = np.zeros(2), np.zeros(2), 0.0, TICK_NS * 1e-9
    for k in range(round(duration / dt)):
        t = k * dt
        acceleration = np.clip((np.array(velocity) - speed) / dt, -1, 1) * (t > 0.2)
        if t < halt_at:  # a halted robot gets no fresh motion
            motion = PlannedMotion(k * TICK_NS, position, speed, acceleration, yaw, yaw_rate)
        result = mpc.step(
            state,
            MpcInputs(
                k * TICK_NS,
                body.position,
                body.velocity,
                body.rotation,
                body.spin,
                body.feet,
                motion,
                HEIGHT,
                bool(t >= halt_at),
            ),
        )
        state, plan = result.state, result.plan
        failures += result.status is not MpcStatus.SOLVED
        body.feet = np.where(plan.in_stance[:, None], body.feet, plan.footholds)
        heading = np.arctan2(body.rotation[1, 0], body.rotation[0, 0])
        tilt = np.arccos(min(1.0, body.rotation[2, 2]))
        rows.append([t, *body.position, *body.velocity, *position, heading - yaw, tilt])
        body.push(plan.forces, dt)
        position = position + dt * speed + 0.5 * dt * dt * acceleration
        speed, yaw = speed + dt * acceleration, yaw + dt * yaw_rate
    return np.array(rows), result, failures


def test_standing_robot_is_carried_evenly():
    plan = one_step(standing_inputs()).plan
    # R = 0.01 pulls on the forces: at 20 ms that costs far less than 1 % of the weight.
    np.testing.assert_allclose(plan.forces[:, 2].sum(), WEIGHT, rtol=0.01)
    np.testing.assert_allclose(plan.forces[:, 2], WEIGHT / 4, rtol=0.01)
    np.testing.assert_allclose(plan.forces[:, :2].sum(axis=0), 0.0, atol=1e-3)
    np.testing.assert_allclose(plan.predicted[:3], [0.0, 0.0, HEIGHT], atol=1e-5)


@pytest.mark.parametrize(
    ('changes', 'component', 'sign'),
    [
        ({'position': np.array([0.0, 0.0, HEIGHT - 0.01])}, 2, +1),
        ({'velocity': np.array([0.0, 0.0, 0.1])}, 2, -1),
        ({'position': np.array([0.02, 0.0, HEIGHT])}, 0, -1),
        ({'position': np.array([0.0, -0.005, HEIGHT])}, 1, +1),
        ({'rotation': exp_rotation(np.array([0.01, 0.0, 0.0]))}, 3, -1),
        ({'rotation': exp_rotation(np.array([0.0, -0.01, 0.0]))}, 4, +1),
        ({'rotation': exp_rotation(np.array([0.0, 0.0, 0.01]))}, 5, -1),
        ({'angular_velocity': np.array([0.0, 0.0, -0.2])}, 5, +1),
        ({'motion': dataclasses.replace(STANDING, yaw=0.01)}, 5, +1),
    ],
)
def test_wrench_drives_every_error_back(changes, component, sign):
    inputs = standing_inputs(**changes)
    forces = one_step(inputs).plan.forces
    torque = np.cross(inputs.feet - inputs.position, forces).sum(axis=0)
    wrench = np.concatenate((forces.sum(axis=0) - [0.0, 0.0, WEIGHT], torque))
    assert sign * wrench[component] > 0.1  # [N] or [Nm]; standing still gives 1e-3


@pytest.mark.parametrize('friction', [0.3, 0.6])
@pytest.mark.parametrize('target', [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)])
def test_forces_use_the_friction_pyramid_and_do_not_leave_it(friction, target):
    far = dataclasses.replace(STANDING, position=np.array(target))
    forces = one_step(standing_inputs(motion=far), friction=friction).plan.forces
    horizontal, limit = np.abs(forces[:, :2]).max(axis=1), friction * forces[:, 2]
    assert (horizontal <= limit + 1e-4).all()  # 100 times the solver's tolerance
    assert np.isclose(horizontal, limit, atol=1e-3).any()
    assert ((forces[:, 2] >= -1e-4) & (forces[:, 2] <= 250.0 + 1e-4)).all()


def test_planned_acceleration_is_fed_forward():
    moving = dataclasses.replace(STANDING, acceleration=np.array([0.0, 0.5]))
    aware = one_step(standing_inputs(motion=moving)).plan.forces[:, 1].sum()
    # Speed and position are the integrals of 0.5 m/s^2, so the force is about m a; the
    # tracking weights, not the model, decide how exactly within the short horizon.
    assert aware == pytest.approx(BODY.mass * 0.5, rel=0.1)
    weights = (0.0, 0.0, 3e6, 1e5, 1e5, *PAPER_STATE_WEIGHTS[5:])
    by_speed = one_step(standing_inputs(motion=moving), state_weights=weights).plan.forces
    assert by_speed[:, 1].sum() == pytest.approx(BODY.mass * 0.5, rel=0.3)


@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_a_pushed_robot_sets_its_feet_down_where_they_catch_it(sign):
    trotting = {'stand_time': 0.0, 'raibert_gain': 0.05, 'position_gain': 0.2}
    calm = one_step(standing_inputs(), **trotting).plan.footholds
    fast = standing_inputs(velocity=np.array([0.0, 0.3 * sign, 0.0]))
    off = standing_inputs(position=np.array([0.1 * sign, 0.0, HEIGHT]))
    swings = [0, 3]
    shift = (one_step(fast, **trotting).plan.footholds - calm)[swings]
    # 0.2 s of swing and half of 0.2 s of stance at 0.3 m/s, and Raibert's 0.05 s.
    np.testing.assert_allclose(shift, [[0.0, sign * 0.3 * 0.35, 0.0]] * 2, atol=1e-12)
    shift = (one_step(off, **trotting).plan.footholds - calm)[swings]
    np.testing.assert_allclose(shift, [[sign * 0.1 * 1.2, 0.0, 0.0]] * 2, atol=1e-12)


def test_the_com_is_kept_amid_the_feet_wherever_offsets_are_counted_from():
    parameters = GroundForceParameters(stand_time=0.0)
    shifted = dataclasses.replace(BODY, hip_offsets=BODY.hip_offsets + np.array([0.01, -0.02, 0.3]))
    plans = []
    for body in (BODY, shifted):
        mpc = GroundForceMpc(parameters, body)
        plans.append(mpc.step(mpc.start(0), standing_inputs()).plan)
    np.testing.assert_allclose(plans[1].footholds, plans[0].footholds, atol=1e-12)


def random_problem(seed, standing_feet):
    """A stable random affine model and stance pattern, for the condensing alone."""
    rng = np.random.default_rng(seed)
    model = AffineModel(
        np.eye(12) + 0.05 * rng.normal(size=(12, 12)),
        0.01 * rng.normal(size=(12, 12)),
        0.1 * rng.normal(size=12),
    )
    in_stance = np.zeros((5, 4), dtype=bool)
    for row in in_stance:
        row[rng.permutation(4)[:standing_feet]] = True
    return model, rng.normal(size=12), rng.normal(size=(5, 12)), in_stance


@pytest.mark.parametrize('standing_feet', [2, 3, 4])
def test_condensed_cost_is_the_cost_of_the_simulated_trajectory(standing_feet):
    parameters = GroundForceParameters()
    model, eta, desired, in_stance = random_problem(standing_feet, standing_feet)
    cost = CondensedQp(parameters).condense(model, eta, desired, in_stance)

    def simulated(x):
        forces = np.zeros((5, 4, 3))
        forces[in_stance] = x.reshape(-1, 3)
        state, total = eta, 0.005 * (x @ x)
        for k in range(5):
            state = model.state @ state + model.force @ forces[k].ravel() + model.offset
            weights = np.array(PAPER_STATE_WEIGHTS) * (0.1 if k == 4 else 1.0)
            total += 0.5 * weights @ (state - desired[k]) ** 2
        return total

    rng = np.random.default_rng(0)
    for x in rng.normal(scale=50.0, size=(3, len(cost.gradient))):
        condensed = 0.5 * x @ cost.hessian @ x + cost.gradient @ x
        assert simulated(x) - simulated(0 * x) == pytest.approx(condensed, rel=1e-9)


@pytest.mark.parametrize('standing_feet', [2, 3, 4])
@pytest.mark.parametrize('seed', range(5))
def test_solution_satisfies_the_optimality_conditions(seed, standing_feet):
    parameters = GroundForceParameters(state_weights=(1e4,) * 12)
    qp = CondensedQp(parameters)
    cost = qp.condense(*random_problem(seed, standing_feet))
    solution = qp.solve(cost)
    pyramid = force_pyramid(5 * standing_feet, parameters.friction, parameters.max_normal_force)
    x, z, values = solution.forces, solution.multipliers, pyramid.rows @ solution.forces
    assert solution.solved
    # A hundred times the solver's tolerance, which sums up over all rows.
    np.testing.assert_allclose(cost.hessian @ x + cost.gradient + pyramid.rows.T @ z, 0, atol=2e-6)
    assert (values >= pyramid.lower - 2e-6).all()
    assert (values <= pyramid.upper + 2e-6).all()
    # A multiplier pushes only at the bound it belongs to: up to 1e3 times a slack of 1e-6.
    bounded = pyramid.upper < 1e19
    assert (z[~bounded] < 2e-6).all()
    assert np.abs(np.minimum(z, 0.0) * (values - pyramid.lower)).max() < 1e-3
    assert np.abs((np.maximum(z, 0.0) * (pyramid.upper - values))[bounded]).max() < 1e-3
    assert np.count_nonzero(np.abs(z) > 1e-3) > 0  # the problem isn't trivial
    assert solution.primal_residual <= 1e-6


@pytest.mark.parametrize('seed', range(6))
def test_where_a_solve_begins_is_not_to_be_seen_in_its_forces(seed):
    """What the tolerance leaves open is next to nothing beside what rounding takes away."""
    parameters = GroundForceParameters(state_weights=(1.0,) * 12)
    fresh, warm = CondensedQp(parameters), CondensedQp(parameters)
    cost = fresh.condense(*random_problem(seed, 4))
    near = Cost(cost.hessian, cost.gradient * 1.1)
    assert warm.solve(near).solved
    difference = np.abs(fresh.solve(cost).forces - warm.solve(cost).forces).max()
    assert difference < 1e-5 * parameters.force_resolution


def test_a_poisoned_solve_leaves_no_trace():
    qp = CondensedQp(GroundForceParameters())
    good = qp.condense(*random_problem(1, 2))
    for bad in (np.nan, np.inf):
        assert not qp.solve(Cost(good.hessian * bad, good.gradient)).solved
        assert not qp.solve(Cost(good.hessian, good.gradient * bad)).solved
        assert qp.solve(good).solved


def test_trot_keeps_height_and_speed():
    rows, result, failures = walk(4.0, (0.5, 0.0))
    settled = rows[rows[:, 0] > 2.0]
    assert failures == 0
    assert np.abs(settled[:, 3] - HEIGHT).max() < 0.003
    assert settled[:, 4].mean() == pytest.approx(0.5, rel=0.03)
    assert np.abs(settled[:, 2]).max() < 0.01
    assert settled[:, -1].max() < np.radians(0.5)
    assert np.count_nonzero(result.plan.in_stance) == 2
    swings = ~result.plan.in_stance
    np.testing.assert_array_equal(result.plan.forces[swings], 0.0)
    np.testing.assert_allclose(result.plan.footholds[swings, 2], 0.02)


def test_trot_turns_and_sidesteps():
    rows, _, failures = walk(4.0, (0.0, 0.3), yaw_rate=0.5)
    settled = rows[rows[:, 0] > 2.0]
    assert failures == 0
    assert np.abs(settled[:, 3] - HEIGHT).max() < 0.003
    assert settled[:, 5].mean() == pytest.approx(0.3, rel=0.03)
    assert np.abs(settled[:, -2]).max() < np.radians(0.5)


def test_halted_robot_brakes_and_stands_on_four_feet():
    rows, result, failures = walk(4.0, (0.5, 0.0), halt_at=2.07)
    assert failures == 0
    assert result.plan.in_stance.all()
    assert np.abs(rows[-1, 4:7]).max() < 0.02
    # From 0.5 m/s at 1 m/s^2 it takes 0.125 m; as much again covers the speed of tracking.
    stopping = rows[-1, 1] - rows[np.searchsorted(rows[:, 0], 2.07), 1]
    assert 0.05 < stopping < 0.25


def planned(height, climb=0.0, velocity=0.0):
    return dataclasses.replace(
        STANDING, height=height, vertical_velocity=climb, velocity=np.array([velocity, 0.0])
    )


def test_a_robot_that_sits_is_carried_where_it_is_planned():
    """At its planned height it carries its weight; above it less, below it more."""
    for lower, compare in ((-0.05, 'same'), (-0.06, 'less'), (-0.04, 'more')):
        inputs = standing_inputs(position=np.array([0.0, 0.0, 0.21]), motion=planned(lower))
        carried = one_step(inputs).plan.forces[:, 2].sum()
        if compare == 'same':
            assert carried == pytest.approx(WEIGHT, rel=0.01)
        else:
            assert (carried < 0.95 * WEIGHT) == (compare == 'less')


def test_a_planned_descent_accelerates_the_body_downwards():
    still, sinking = (one_step(standing_inputs(motion=planned(0.0, v))) for v in (0.0, -0.1))
    assert sinking.plan.predicted[5] < still.plan.predicted[5] - 0.01


def test_the_gait_ends_when_the_robot_is_to_sit_or_is_not_up_yet():
    """However fast it is, for at most one swing more; up again, it trots on."""
    mpc = GroundForceMpc(GroundForceParameters(), BODY)
    state, stances = mpc.start(0), []
    for k in range(600):
        height = -0.01 if 200 <= k < 400 else 0.0
        motion = dataclasses.replace(planned(height, velocity=0.3), stamp_ns=k * TICK_NS)
        result = mpc.step(state, standing_inputs(stamp_ns=k * TICK_NS, motion=motion))
        state = result.state
        stances.append(result.plan.in_stance.all())
    assert not any(stances[150:200])
    assert all(stances[300:400])  # 0.2 s is a swing
    assert not any(stances[405:])


def test_halted_robot_steps_on_until_it_is_slow():
    _, result, _ = walk(2.35, (0.5, 0.0), halt_at=2.07)  # 0.28 s after: still 0.22 m/s planned
    assert not result.plan.in_stance.all()


def test_stand_never_lifts_a_foot():
    rows, result, failures = walk(1.0, (0.0, 0.0), gait='stand')
    assert failures == 0
    assert result.plan.in_stance.all()
    assert np.abs(rows[:, 1:4] - [0.0, 0.0, HEIGHT]).max() < 1e-4  # R's pull costs 10 um


def test_a_bad_input_gives_static_forces_and_no_trace_later():
    mpc = GroundForceMpc(GroundForceParameters(), BODY)
    good = standing_inputs()
    expected = mpc.step(mpc.start(0), good).plan
    bad = dataclasses.replace(good, velocity=np.array([0.0, np.nan, 0.0]))
    result = mpc.step(mpc.start(0), bad)
    assert result.status is MpcStatus.BAD_INPUT
    np.testing.assert_allclose(result.plan.forces, np.tile([0, 0, WEIGHT / 4], (4, 1)))
    for field in ('forces', 'footholds', 'swing_phase', 'swing_rate', 'predicted'):
        assert np.isfinite(getattr(result.plan, field)).all()
    again = mpc.step(result.state, good)
    assert again.status is MpcStatus.SOLVED
    np.testing.assert_allclose(again.plan.forces, expected.forces, atol=1e-3)


@pytest.mark.parametrize('field', ['position', 'rotation', 'angular_velocity', 'feet', 'height'])
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_anything_that_is_not_finite_is_noticed(field, value):
    damaged = np.array(getattr(standing_inputs(), field), dtype=float)
    damaged.flat[-1] = value
    result = one_step(standing_inputs(**{field: damaged}))
    assert result.status is MpcStatus.BAD_INPUT
    motion = dataclasses.replace(STANDING, acceleration=np.array([0.0, value]))
    assert one_step(standing_inputs(motion=motion)).status is MpcStatus.BAD_INPUT


def test_a_solver_that_gives_up_leaves_the_weight_on_the_standing_feet():
    far = dataclasses.replace(STANDING, position=np.array([1.0, -1.0]))
    result = one_step(standing_inputs(motion=far), solver_iterations=1, solver_inner_iterations=1)
    assert result.status is MpcStatus.SOLVER_FAILED
    np.testing.assert_allclose(result.plan.forces, np.tile([0, 0, WEIGHT / 4], (4, 1)))
    assert np.isfinite(result.plan.predicted).all()


def test_static_forces_balance_gravity_on_the_feet_that_stand():
    forces = static_forces(np.array([True, False, False, True]), BODY.mass)
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, WEIGHT])
    np.testing.assert_array_equal(forces[[1, 2]], 0.0)
    np.testing.assert_array_equal(static_forces(np.zeros(4, dtype=bool), BODY.mass), 0.0)
