"""The quadratic program that filters everybody's desired input (paper eq. (21))."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
import proxsuite

from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import Array

FAR = 1e20
_FRESH = proxsuite.proxqp.InitialGuess.NO_INITIAL_GUESS
_WARM = proxsuite.proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT


class QpStatus(enum.Enum):
    """How a solve ended; INACCURATE is also what an infeasible problem gives."""

    SOLVED = 'solved'
    INACCURATE = 'inaccurate'
    NOT_FINITE = 'not finite'


@dataclass(frozen=True, slots=True)
class QpSolution:
    """Result of one solve.

    Attributes:
        status: How it ended; u and slack are only meaningful if SOLVED.
        u: Inputs of all agents, agent by agent [m/s^2], (2 N,).
        slack: By how much each row is broken [m/s^2], (M,).
        multipliers: Of the rows, (M,), not negative.
        primal_residual: Largest violation of rows and bounds [m/s^2].
        dual_residual: Largest entry of the Lagrangian's gradient with respect to u,
            the multipliers of its limits included [m/s^2].
    """

    status: QpStatus
    u: Array
    slack: Array
    multipliers: Array
    primal_residual: float
    dual_residual: float


class PlannerQp:
    """Workspace of one problem size.

    minimise   1/2 |u - u_desired|^2 + sum over soft rows (weight s + 1/2 s^2)
    such that  coefficients . u + s >= bound,  s >= 0,  lower <= u <= upper.

    The linear penalty is exact: s = 0 wherever the hard problem has a solution with
    multipliers below the weight. Otherwise the slack tells which promise is broken.
    """

    def __init__(self, inputs: int, weights: Array, parameters: CoordinatorParameters) -> None:
        """Allocate the problem.

        Args:
            inputs: Number of inputs, 2 N.
            weights: Penalty of each row's slack [s^2/m], infinite for hard rows, (M,).
            parameters: Solver settings.
        """
        soft = np.flatnonzero(np.isfinite(weights))
        rows, size = len(weights), inputs + len(soft)
        self._inputs, self._soft = inputs, soft
        self._tolerance = parameters.residual_tolerance
        self._gradient = np.concatenate((np.zeros(inputs), weights[soft]))
        self._matrix = np.zeros((rows, size))
        self._matrix[soft, inputs + np.arange(len(soft))] = 1.0
        self._lower = np.zeros(size)
        self._upper = np.full(size, FAR)
        self._no_limit = np.full(rows, FAR)
        self._qp = _workspace(size, rows, parameters)
        self._hessian = np.eye(size)
        self._ready = False

    def solve(
        self, desired: Array, coefficients: Array, bound: Array, lower: Array, upper: Array
    ) -> QpSolution:
        """Solve for one tick; a bad problem or a bad answer is a status, not an error.

        Args:
            desired: k_d [m/s^2], (2 N,).
            coefficients, bound: The rows, (M, 2 N), (M,) [m/s^2].
            lower, upper: Hard limits of the inputs [m/s^2], (2 N,) each.
        """
        inputs = self._inputs
        self._gradient[:inputs] = -desired
        self._matrix[:, :inputs] = coefficients
        self._lower[:inputs] = lower
        self._upper[:inputs] = upper
        size = sum(float(np.vdot(v, v)) for v in (desired, coefficients, bound, lower, upper))
        if not math.isfinite(size):
            return self._failed(QpStatus.NOT_FINITE)
        solution = self._attempt(bound, fresh=not self._ready)
        if solution.status is not QpStatus.SOLVED:
            solution = self._attempt(bound, fresh=True)
        return solution

    def _attempt(self, bound: Array, fresh: bool) -> QpSolution:
        """Solve from the last solution, or from nothing if that might mislead."""
        settings, g, c = self._qp.settings, self._gradient, self._matrix
        low, high = self._lower, self._upper
        settings.initial_guess = _FRESH if fresh else _WARM
        if fresh:
            self._qp.init(self._hessian, g, None, None, c, bound, self._no_limit, low, high)
        else:
            self._qp.update(g=g, C=c, l=bound, l_box=low, u_box=high)
        self._qp.solve()
        self._ready = True
        return self._checked(bound)

    def _checked(self, bound: Array) -> QpSolution:
        """Check the answer by plain arithmetic, whatever the solver says of itself."""
        inputs, matrix, results = self._inputs, self._matrix, self._qp.results
        x, z = results.x, results.z
        allowed = np.minimum(np.maximum(x, self._lower), self._upper)
        broken = max(
            float((bound - matrix @ allowed).max(initial=0.0)),
            float(np.abs(x - allowed).max()),
        )
        multipliers = -z[: len(bound)]
        gradient = x[:inputs] + self._gradient[:inputs] - multipliers @ matrix[:, :inputs]
        dual = float(np.abs(gradient + z[len(bound) : len(bound) + inputs]).max())
        if not math.isfinite(broken + dual):
            return self._failed(QpStatus.NOT_FINITE)
        if max(broken, dual) > self._tolerance:
            return self._failed(QpStatus.INACCURATE, broken, dual)
        slack = np.zeros(len(bound))
        slack[self._soft] = allowed[inputs:]
        u = allowed[:inputs]
        return QpSolution(QpStatus.SOLVED, u, slack, multipliers, broken, dual)

    def _failed(self, status: QpStatus, primal: float = np.inf, dual: float = np.inf) -> QpSolution:
        """Return the failure; the next solve starts afresh, not from a poisoned guess."""
        self._ready = False
        rows = len(self._no_limit)
        u, zeros = np.full(self._inputs, np.nan), np.zeros(rows)
        return QpSolution(status, u, zeros, zeros, primal, dual)


def braking_input(velocity: Array, time_constant: float, limit: float) -> Array:
    """Return the fallback input u = -v / T within its limits.

    Args:
        velocity: Planned velocities [m/s], (N, 2).
        time_constant: T [s].
        limit: Largest input per axis [m/s^2].
    """
    u: Array = np.minimum(np.maximum(velocity / -time_constant, -limit), limit)
    return u


def chosen_input(solution: QpSolution, brake: Array) -> Array:
    """Return what is applied: the solution if there is one, else the brake.

    Args:
        solution: Of the QP.
        brake: Fallback input [m/s^2], (N, 2).

    Returns:
        Inputs [m/s^2], (N, 2).
    """
    if solution.status is QpStatus.SOLVED:
        return solution.u.reshape(-1, 2)
    return brake


def unfiltered(desired: Array, rows: int, lower: Array, upper: Array) -> QpSolution:
    """Return the solution of the program without its rows: the input nearest to the wish.

    Args:
        desired: k_d [m/s^2], (2 N,).
        rows: Number of rows that are left out.
        lower, upper: Hard limits of the inputs [m/s^2], (2 N,) each.
    """
    u, zeros = np.minimum(np.maximum(desired, lower), upper), np.zeros(rows)
    return QpSolution(QpStatus.SOLVED, u, zeros, zeros, 0.0, 0.0)


def _workspace(
    size: int, rows: int, parameters: CoordinatorParameters
) -> proxsuite.proxqp.dense.QP:
    """Return a solver whose iterations are bounded and whose answers are exact."""
    qp = proxsuite.proxqp.dense.QP(
        size,
        0,
        rows,
        True,
        proxsuite.proxqp.dense.HessianType.Dense,
        proxsuite.proxqp.dense.DenseBackend.PrimalDualLDLT,
    )
    settings = qp.settings
    settings.eps_abs = parameters.solver_accuracy
    settings.eps_rel = 0.0
    settings.check_duality_gap = True
    settings.eps_duality_gap_abs = parameters.solver_accuracy
    settings.eps_duality_gap_rel = 0.0
    settings.eps_primal_inf = 1e-14
    settings.eps_dual_inf = 1e-14
    settings.max_iter = parameters.solver_iterations
    settings.max_iter_in = parameters.solver_inner_iterations
    settings.verbose = False
    return qp
