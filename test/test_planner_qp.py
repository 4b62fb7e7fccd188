"""The planner's QP is solved exactly, gives way exactly, and never returns nonsense."""

import numpy as np
import pytest

from layered_cbf_ros.coordination.barriers import HARD
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.planner_qp import (
    PlannerQp,
    QpStatus,
    braking_input,
    chosen_input,
)

P = CoordinatorParameters()
LIMIT = np.full(4, 1.5)


def random_problem(seed, rows=7, low=-1.5, high=0.3):
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=(rows, 4))
    coefficients /= np.linalg.norm(coefficients, axis=1)[:, None]
    return rng.uniform(-1.5, 1.5, 4), coefficients, rng.uniform(low, high, rows)


@pytest.mark.parametrize('seed', range(25))
def test_solution_satisfies_the_kkt_conditions(seed):
    """Stationarity, feasibility, complementarity, and the duals' bounds by the penalty.

    1e-5 is ten times the accuracy asked of the solver. Infeasible draws are among them.
    """
    desired, coefficients, bound = random_problem(seed, high=1.5 if seed % 2 else 0.3)
    solution = PlannerQp(4, np.full(7, P.slack_weight), P).solve(
        desired, coefficients, bound, -LIMIT, LIMIT
    )
    assert solution.status is QpStatus.SOLVED
    u, s, y = solution.u, solution.slack, solution.multipliers
    surplus = coefficients @ u + s - bound
    assert surplus.min() >= -1e-5
    assert y.min() >= -1e-5
    assert np.abs(np.minimum(surplus, y)).max() < 1e-5
    assert np.abs(np.minimum(s, P.slack_weight + s - y)).max() < 1e-5
    gradient = u - desired - coefficients.T @ y
    inside = np.abs(u) < 1.5 - 1e-6
    assert np.abs(gradient[inside]).max(initial=0.0) < 1e-5
    assert (gradient[u >= 1.5 - 1e-6] <= 1e-5).all()
    assert (gradient[u <= -1.5 + 1e-6] >= -1e-5).all()


@pytest.mark.parametrize('seed', range(10))
def test_slack_is_exact(seed):
    """Where the hard problem can be solved, the soft one has the same solution."""
    desired, coefficients, bound = random_problem(seed, high=0.0)
    arguments = desired, coefficients, bound, -LIMIT, LIMIT
    soft = PlannerQp(4, np.full(7, P.slack_weight), P).solve(*arguments)
    hard = PlannerQp(4, np.full(7, HARD), P).solve(*arguments)
    assert hard.status is soft.status is QpStatus.SOLVED
    assert np.allclose(soft.u, hard.u, atol=1e-5)
    assert soft.slack.max() < 1e-6


def test_contradicting_rows_are_given_up_by_as_little_as_possible():
    """u >= 1 and -u >= 1 lack 2 in sum, and hard rows are never given up."""
    coefficients = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]])
    arguments = np.zeros(4), coefficients, np.ones(2), -LIMIT, LIMIT
    both = PlannerQp(4, np.full(2, 1000.0), P).solve(*arguments)
    assert both.slack.sum() == pytest.approx(2.0, abs=1e-5)
    one = PlannerQp(4, np.array([HARD, 1000.0]), P).solve(*arguments)
    assert one.slack == pytest.approx([0.0, 2.0], abs=1e-5)
    assert one.u[0] == pytest.approx(1.0, abs=1e-5)


def test_impossible_hard_rows_are_a_status_and_end_in_a_brake():
    coefficients = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]])
    problem = PlannerQp(4, np.full(2, HARD), P)
    solution = problem.solve(np.zeros(4), coefficients, np.ones(2), -LIMIT, LIMIT)
    assert solution.status is QpStatus.INACCURATE
    brake = braking_input(np.array([[0.4, 0.0], [0.0, -2.0]]), 0.4, 1.5)
    assert np.array_equal(chosen_input(solution, brake), [[-1.0, 0.0], [0.0, 1.5]])
    again = problem.solve(np.ones(4), coefficients, -np.ones(2), -LIMIT, LIMIT)
    assert again.status is QpStatus.SOLVED
    assert np.allclose(again.u, np.ones(4), atol=1e-6)


@pytest.mark.parametrize('place', range(5))
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_a_status_and_poisons_nothing(place, value):
    desired, coefficients, bound = random_problem(3)
    problem = PlannerQp(4, np.full(7, 1000.0), P)
    good = [desired, coefficients, bound, -LIMIT, LIMIT]
    before = problem.solve(*good)
    bad = [argument.copy() for argument in good]
    bad[place].flat[1] = value
    assert problem.solve(*bad).status is QpStatus.NOT_FINITE
    after = problem.solve(*good)
    assert after.status is QpStatus.SOLVED
    assert np.allclose(after.u, before.u, atol=1e-5)


def test_without_rows_the_wish_is_granted_within_its_limits():
    problem = PlannerQp(4, np.zeros(0), P)
    solution = problem.solve(
        np.array([0.2, 9.0, -9.0, 0.0]), np.zeros((0, 4)), np.zeros(0), -LIMIT, LIMIT
    )
    assert solution.status is QpStatus.SOLVED
    assert np.allclose(solution.u, [0.2, 1.5, -1.5, 0.0], atol=1e-6)


def test_warm_started_sequence_equals_fresh_solves():
    """Rows that come and go along a trajectory leave no trace in later solutions."""
    desired, coefficients, bound = random_problem(8)
    problem = PlannerQp(4, np.full(7, 1000.0), P)
    for k in range(200):
        wish, limit = desired + np.sin(0.05 * k), bound + 0.8 * np.sin(0.11 * k + np.arange(7))
        arguments = wish, coefficients, limit, -LIMIT, LIMIT
        warm = problem.solve(*arguments)
        if k % 20 == 0:
            fresh = PlannerQp(4, np.full(7, 1000.0), P).solve(*arguments)
            assert warm.status is fresh.status is QpStatus.SOLVED
            assert np.allclose(warm.u, fresh.u, atol=1e-5)
