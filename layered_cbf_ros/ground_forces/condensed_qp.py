"""The MPC of paper eq. (23) as a small dense QP in the forces of the feet that stand.

The states are eliminated through the dynamics, and so are the forces of swing
feet: their columns are dropped, not pinned to zero. What is left is

    min 1/2 x^T H x + g^T x   subject to   lower <= C x <= upper,

with x the forces (x, y, z) of each standing foot, step after step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from proxsuite import proxqp

from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.ground_forces.single_rigid_body import AffineModel
from layered_cbf_ros.interfaces import Array

INFINITE = 1e20  # proxsuite's own convention for "no bound"
ROUND_OFF = 1e-13  # of a sum, relative to its terms: no residual gets smaller
NEVER_INFEASIBLE = 1e-14  # looser values declared feasible problems infeasible
FEET = 4


@dataclass(frozen=True)
class Cost:
    """Hessian H (n, n) and gradient g (n,) of the condensed cost at x = 0."""

    hessian: Array
    gradient: Array


@dataclass(frozen=True)
class ForcePyramid:
    """lower <= rows @ x <= upper, five rows a foot; see `force_pyramid`."""

    rows: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class QpSolution:
    """What a solve returned.

    Attributes:
        solved: Whether the solver met its tolerance and all is finite.
        forces: The minimiser x [N], (n,).
        multipliers: Of the pyramid's rows, (m,); positive at the upper bound.
        primal_residual: Largest violation of the pyramid, as the solver says [N].
    """

    solved: bool
    forces: Array
    multipliers: Array
    primal_residual: float


def force_pyramid(feet: int, friction: float, max_normal_force: float) -> ForcePyramid:
    """Return |f_x| <= mu f_z, |f_y| <= mu f_z and 0 <= f_z <= f_max for some feet."""
    mu = friction
    foot = np.array([[1, 0, mu], [-1, 0, mu], [0, 1, mu], [0, -1, mu], [0, 0, 1]])
    upper = np.array(4 * [INFINITE] + [max_normal_force])
    rows = np.kron(np.eye(feet), foot).astype(np.float64)
    return ForcePyramid(rows, np.zeros(5 * feet), np.tile(upper, feet))


class CondensedQp:
    """Builds and solves the MPC problem, one solver a number of standing feet.

    Its only memory is the solvers' warm start.

    Args:
        parameters: Of the middle layer.
    """

    def __init__(self, parameters: GroundForceParameters) -> None:
        steps = parameters.horizon
        self._parameters = parameters
        weights = np.tile(parameters.state_weights, (steps, 1))
        weights[-1] *= parameters.terminal_factor
        self._root_weights = np.sqrt(weights).ravel()
        self._pulses = np.zeros((2 * steps - 1, 12, 3 * FEET + 1))
        self._response = np.zeros((steps, 12, 3 * FEET * steps))
        # Any duty >= 0.5 leaves at least one diagonal pair standing at every step.
        sizes = range(2 * steps, 4 * steps + 1)
        self._pyramids = {
            n: force_pyramid(n, parameters.friction, parameters.max_normal_force) for n in sizes
        }
        self._solvers = {n: self._new_solver(n) for n in sizes}

    def condense(
        self, model: AffineModel, eta: Array, desired: Array, in_stance: NDArray[np.bool_]
    ) -> Cost:
        """Write the cost of paper eq. (23) in the forces of standing feet.

        The states are X = free + G x, with G's block (k, j) = C^(k-j) D for j <= k,
        and free_k = eta + sum_{j<=k} C^j (C eta + eps - eta) without forces, so that
        H = G^T Q G + R and g = G^T Q (free - desired), Q's last block being P.

        Args:
            model: C, D, eps of one step.
            eta: Present state, (12,).
            desired: States wanted after 1..N_h steps, (N_h, 12).
            in_stance: Which feet stand during each step, (N_h, 4).
        """
        steps = len(desired)
        pulses = self._pulses  # the first steps - 1 stay zero: no effect before its cause
        pulses[steps - 1, :, :-1] = model.force
        pulses[steps - 1, :, -1] = model.state @ eta + model.offset - eta
        for k in range(steps, 2 * steps - 1):
            np.matmul(model.state, pulses[k - 1], out=pulses[k])
        for j in range(steps):
            first = steps - 1 - j
            self._response[:, :, 12 * j : 12 * (j + 1)] = pulses[first : first + steps, :, :-1]
        columns = in_stance.ravel().repeat(3).nonzero()[0]
        response = self._response.reshape(12 * steps, -1).take(columns, axis=1)
        response *= self._root_weights[:, None]
        hessian = response.T @ response
        hessian.ravel()[:: len(columns) + 1] += self._parameters.force_weight
        error = eta + pulses[steps - 1 :, :, -1].cumsum(axis=0) - desired
        return Cost(hessian, (self._root_weights * error.ravel()) @ response)

    def solve(self, cost: Cost) -> QpSolution:
        """Minimise the cost over the force pyramids; failing is a value."""
        n = len(cost.gradient) // 3
        if not np.isfinite(cost.gradient).all():
            return QpSolution(False, np.zeros(3 * n), np.zeros(5 * n), np.inf)
        solver = self._solvers[n]
        solver.update(H=cost.hessian, g=cost.gradient, update_preconditioner=False)
        solver.solve()
        forces, multipliers = np.array(solver.results.x), np.array(solver.results.z)
        info = solver.results.info
        solved = info.status == proxqp.QPSolverOutput.PROXQP_SOLVED
        solved = solved and bool(np.isfinite(forces).all())
        if not solved:  # a bad warm start must not spoil the next tick
            self._solvers[n] = self._new_solver(n)
        return QpSolution(solved, forces, multipliers, float(info.pri_res))

    def _new_solver(self, feet: int) -> proxqp.dense.QP:
        """Return a solver for a number of standing feet, its first solve already done."""
        pyramid, n = self._pyramids[feet], 3 * feet
        solver = proxqp.dense.QP(
            n, 0, 5 * feet, dense_backend=proxqp.dense.DenseBackend.PrimalDualLDLT
        )
        settings, tolerance = solver.settings, self._parameters.solver_tolerance
        settings.eps_abs, settings.eps_rel = tolerance, ROUND_OFF
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = tolerance, ROUND_OFF
        settings.eps_primal_inf = settings.eps_dual_inf = NEVER_INFEASIBLE
        settings.max_iter = self._parameters.solver_iterations
        settings.max_iter_in = self._parameters.solver_inner_iterations
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        settings.compute_timings = False
        solver.init(
            H=np.eye(n),
            g=np.tile([0.0, 0.0, -1.0], feet),
            C=pyramid.rows,
            l=pyramid.lower,
            u=pyramid.upper,
            compute_preconditioner=False,
        )
        solver.solve()
        return solver
