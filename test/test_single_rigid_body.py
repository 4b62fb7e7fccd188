import numpy as np
import pytest

from layered_cbf_ros.ground_forces.single_rigid_body import (
    AffineModel,
    RigidBody,
    SingleRigidBody,
    derivative,
    discretise,
    exp_rotation,
    log_rotation,
    skew,
)

GRAVITY = np.array([0.0, 0.0, -9.81])
BODY = RigidBody(
    12.458,
    np.array([[0.155, 0.003, -0.008], [0.003, 0.397, 0.002], [-0.008, 0.002, 0.418]]),
    np.array([[x, y, 0.0] for x in (0.183, -0.183) for y in (0.132, -0.132)]),
)


def series_exponential(vector):
    """Sum the power series of the matrix exponential; 40 terms are exact up to pi."""
    generator = np.array(
        [[0, -vector[2], vector[1]], [vector[2], 0, -vector[0]], [-vector[1], vector[0], 0]]
    )
    term, total = np.eye(3), np.eye(3)
    for k in range(1, 40):
        term = term @ generator / k
        total = total + term
    return total


def random_situation(seed):
    """A tilted, turning body on four feet with arbitrary forces."""
    rng = np.random.default_rng(seed)
    rotation = series_exponential(rng.uniform(-0.8, 0.8, 3))
    eta = np.concatenate((rng.uniform(-1, 1, 6), np.zeros(3), rng.uniform(-2, 2, 3)))
    feet = BODY.hip_offsets + eta[:3] + rng.uniform(-0.1, 0.1, (4, 3)) - [0.0, 0.0, 0.24]
    return rotation, eta, feet, rng.uniform(-80, 80, (4, 3))


@pytest.mark.parametrize('angle', [0.0, 1e-9, 1e-4, 0.3, 1.7, 3.0, np.pi - 1e-7, np.pi])
@pytest.mark.parametrize('axis', [(1, 0, 0), (0, -1, 0), (0, 0, 1), (1, -2, 3), (-1, -1, 0.1)])
def test_exponential_is_the_power_series_and_logarithm_inverts_it(angle, axis):
    vector = angle * np.array(axis) / np.linalg.norm(axis)
    rotation = exp_rotation(vector)
    # 1e-13: rounding of some 40 terms of size up to pi^3 / 6.
    np.testing.assert_allclose(rotation, series_exponential(vector), atol=1e-13)
    logarithm = log_rotation(rotation)
    np.testing.assert_allclose(exp_rotation(logarithm), rotation, atol=1e-13)
    if angle < 3.1:  # at pi the axis has two signs
        np.testing.assert_allclose(logarithm, vector, atol=1e-13)


def test_skew_is_the_cross_product():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose((skew(a) @ b[:, :, None])[:, :, 0], np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize('seed', range(5))
def test_forces_change_linear_and_angular_momentum_at_the_rate_of_their_wrench(seed):
    rotation, eta, feet, forces = random_situation(seed)
    eta[6:9] = [0.3, -0.5, 0.2]  # away from the operating point, where the chart is curved
    rate = derivative(BODY, rotation, eta, feet, forces)

    def momenta(t):
        state = eta + t * rate
        attitude = rotation @ series_exponential(state[6:9])
        return BODY.mass * state[3:6], attitude @ BODY.inertia @ state[9:12], attitude

    h = 1e-5  # central differences: h^2 times third derivatives (~1e3) is 1e-7
    (p1, l1, r1), (p0, l0, r0) = momenta(h), momenta(-h)
    wrench = np.cross(feet - eta[:3], forces).sum(axis=0)
    np.testing.assert_allclose((p1 - p0) / (2 * h), forces.sum(0) + BODY.mass * GRAVITY, atol=1e-6)
    np.testing.assert_allclose((l1 - l0) / (2 * h), wrench, atol=1e-5)
    attitude = rotation @ series_exponential(eta[6:9])
    spin = attitude.T @ (r1 - r0) / (2 * h)
    np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], eta[9:12], atol=1e-7)


@pytest.mark.parametrize('seed', range(5))
def test_linearisation_is_the_central_difference_of_the_nonlinear_body(seed):
    rotation, eta, feet, forces = random_situation(seed)
    model = SingleRigidBody(BODY, 4).linearise(rotation, eta, feet, forces)

    def rate(d_eta, d_force):
        return derivative(BODY, rotation, eta + d_eta, feet, forces + d_force.reshape(4, 3))

    h, nothing = 1e-5, np.zeros(12)
    by_state = [(rate(h * e, nothing) - rate(-h * e, nothing)) / (2 * h) for e in np.eye(12)]
    by_force = [(rate(nothing, e) - rate(nothing, -e)) / 2 for e in np.eye(12)]  # linear in f
    # Entries reach 1e3; rounding / h is 1e-8, the cubic term h^2 * 1e3 is 1e-7.
    np.testing.assert_allclose(model.state, np.transpose(by_state), atol=1e-6)
    np.testing.assert_allclose(model.force, np.transpose(by_force), atol=1e-10)
    np.testing.assert_allclose(model.after(eta, forces), rate(nothing, nothing), atol=1e-10)


def test_step_is_exact_to_second_order_in_time():
    rotation, eta, feet, forces = random_situation(7)
    model = SingleRigidBody(BODY, 4).linearise(rotation, eta, feet, forces)

    def error(dt):
        state, parts = eta, 200
        for _ in range(parts):  # midpoint rule at dt / 200: 4e4 times finer than the step
            middle = state + 0.5 * dt / parts * model.after(state, forces)
            state = state + dt / parts * model.after(middle, forces)
        return np.abs(discretise(model, dt).after(eta, forces) - state).max()

    # What is cut is O(dt^3): half the step leaves an eighth, or 0.1 to 0.15 with dt^4 terms.
    assert 0.1 < error(0.005) / error(0.01) < 0.15


def test_free_fall_is_exact():
    resting = SingleRigidBody(BODY, 4).linearise(
        np.eye(3), np.zeros(12), BODY.hip_offsets, np.zeros((4, 3))
    )
    step: AffineModel = discretise(resting, 0.02)
    after = step.after(np.zeros(12), np.zeros((4, 3)))
    expected = np.zeros(12)
    expected[2], expected[5] = -0.5 * 9.81 * 0.02**2, -9.81 * 0.02
    np.testing.assert_allclose(after, expected, atol=1e-15)
