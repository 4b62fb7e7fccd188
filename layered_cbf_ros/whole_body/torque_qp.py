"""Joint torques as a quadratic program, paper eq. (26)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import proxsuite

from layered_cbf_ros.interfaces import GRAVITY, Array
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters

_UNBOUNDED = 1e20
"""What proxsuite takes for no bound."""

_EQUALITY_PENALTY = 1e-5
"""Inverse of proxsuite's first penalty on equations: saves two iterations in three."""


@dataclass(frozen=True, slots=True)
class TorqueSolution:
    """Outcome of one solve.

    Attributes:
        solved: True if the torques may be used.
        status: The solver's word for the outcome.
        residual: Largest violation of a constraint [m/s^2], [rad/s^2], [Nm] or [N].
        torques: Joint torques [Nm], (12,).
        forces: Ground reaction forces in the world [N], (4, 3); zero in swing.
        defect: delta, what the output dynamics lack [m/s^2], [rad/s^2], (18,);
            rows as in OutputDynamics, zero for stance feet.
    """

    solved: bool
    status: str
    residual: float
    torques: Array
    forces: Array
    defect: Array


class TorqueQp:
    """min nu_1/2 |tau|^2 + nu_2/2 |f - f_des|^2 + nu_3/2 |delta|^2, paper eq. (26).

    Subject to, with q'' = D^-1 (B tau + J_c^T f - H) put in:
        CoM:          sum f / m - g e_z = a_com + delta
        orientation:  w' = a_ori + delta
        swing toes:   J q'' + J' q' = a_toe + delta
        stance toes:  J_c q'' + J_c' q' = 0 (no slip: the toe spheres roll)
        limits:       |tau| <= limit, |f_x|, |f_y| <= mu f_z.

    Variables are tau (12), three for each foot and delta of the body (6): a foot's
    three are its force in stance and its delta in swing, so that each of the 16
    sets of stance feet makes a problem of 30 variables and 18 equations. Each has
    a solver of its own, made and warmed beforehand; a tick only changes numbers.
    """

    def __init__(self, parameters: WholeBodyParameters, model: RobotModel) -> None:
        """Make the solvers; the model is brought to its nominal pose to warm them."""
        self._model = model
        still = np.zeros(18)
        model.update(model.nominal_configuration(np.zeros(2), 0.0), still)
        self._problems = {
            stance: _StanceProblem(parameters, model.mass, stance)
            for stance in itertools.product((False, True), repeat=4)
        }
        for stance in self._problems:
            self.solve(stance, still, np.zeros((4, 3)))

    def solve(
        self, stance: tuple[bool, ...], acceleration: Array, desired_forces: Array
    ) -> TorqueSolution:
        """Return the torques for the state that the model was updated to.

        Args:
            stance: Which feet carry the robot, (4,).
            acceleration: Desired accelerations, rows as in OutputDynamics, (18,).
            desired_forces: f_des, world [N], (4, 3).
        """
        problem, model = self._problems[stance], self._model
        problem.fill(model, acceleration)
        return problem.solve(desired_forces.ravel())


class _StanceProblem:
    """The program for one set of stance feet."""

    def __init__(
        self, parameters: WholeBodyParameters, mass: float, stance: tuple[bool, ...]
    ) -> None:
        self._accepted = parameters.accepted_residual
        self._planted = np.repeat(stance, 3)
        self._carries = self._planted.astype(np.float64)
        self._force_gain = parameters.cost_scale * parameters.force_weight * self._carries
        self._cost = np.zeros(30)
        self._matrix, self._target = np.zeros((18, 30)), np.zeros(18)
        self._toe_part = np.diag(self._carries - 1.0)
        self._matrix[:3, 12:24] = np.tile(np.eye(3) / mass, 4) * self._carries
        self._matrix[:6, 24:] = -np.eye(6)
        self._rows, self._low, self._high = _limits(parameters, stance)
        self._solver = _solver(parameters, len(self._rows))
        self._solver.init(
            np.diag(_weights(parameters, self._carries)),
            self._cost,
            self._matrix,
            self._target,
            self._rows,
            self._low,
            self._high,
        )

    def fill(self, model: RobotModel, acceleration: Array) -> None:
        """Set the equations for the model's state; see TorqueQp.solve."""
        matrix, planted = self._matrix, self._planted
        turning = model.inverse_mass_matrix[3:6]
        jacobian = np.where(planted[:, None], model.contact_jacobian, model.feet_jacobian)
        toes = jacobian @ model.inverse_mass_matrix
        matrix[3:6, :12], matrix[6:, :12] = turning[:, 6:], toes[:, 6:]
        np.multiply(turning @ jacobian.T, self._carries, out=matrix[3:6, 12:24])
        np.multiply(toes @ jacobian.T, self._carries, out=matrix[6:, 12:24])
        matrix[6:, 12:24] += self._toe_part
        bias = np.where(planted, model.contact_bias.ravel(), model.feet_bias.ravel())
        self._target = target = acceleration.copy()
        target[2] += GRAVITY
        target[3:6] += turning @ model.bias
        target[6:] += toes @ model.bias - bias

    def solve(self, desired_forces: Array) -> TorqueSolution:
        """Solve, and check the solution by plain arithmetic.

        A number that isn't finite doesn't reach the solver.
        """
        np.multiply(self._force_gain, -desired_forces, out=self._cost[12:24])
        if not math.isfinite(self._target.sum() + self._cost.sum()):
            return self._solution(np.zeros(30), 'NOT_FINITE', math.inf)
        self._solver.update(g=self._cost, A=self._matrix, b=self._target)
        self._solver.solve()
        x = self._solver.results.x
        status = self._solver.results.info.status.name.removeprefix('PROXQP_')
        return self._solution(x, status, self._residual(x))

    def _residual(self, x: Array) -> float:
        """Return the largest violation of an equation or a limit; inf for NaN."""
        rows = self._rows @ x
        worst = max(
            float(np.abs(self._matrix @ x - self._target).max()),
            float((rows - self._high).max()),
            float((self._low - rows).max()),
        )
        return worst if math.isfinite(worst) else math.inf

    def _solution(self, x: Array, status: str, residual: float) -> TorqueSolution:
        forces = self._carries * x[12:24]
        defect = np.concatenate((x[24:], x[12:24] - forces))
        solved = status == 'SOLVED' and residual <= self._accepted
        return TorqueSolution(solved, status, residual, x[:12].copy(), forces.reshape(4, 3), defect)


def _weights(parameters: WholeBodyParameters, carries: Array) -> Array:
    """Return the diagonal of the scaled Hessian, (30,)."""
    weights = np.full(30, parameters.defect_weight)
    weights[:12] = parameters.torque_weight
    weights[12:24][carries > 0.0] = parameters.force_weight
    return parameters.cost_scale * weights


def _limits(
    parameters: WholeBodyParameters, stance: tuple[bool, ...]
) -> tuple[Array, Array, Array]:
    """Return rows, lower and upper bounds of the torque limits and friction pyramids."""
    mu = parameters.friction
    feet = [foot for foot, carries in enumerate(stance) if carries]
    rows = np.zeros((12 + 5 * len(feet), 30))
    rows[:12, :12] = np.eye(12)
    pyramid = np.array([[1, 0, mu], [-1, 0, mu], [0, 1, mu], [0, -1, mu], [0, 0, 1]])
    for place, foot in enumerate(feet):
        rows[12 + 5 * place : 17 + 5 * place, 12 + 3 * foot : 15 + 3 * foot] = pyramid
    low, high = np.zeros(len(rows)), np.full(len(rows), _UNBOUNDED)
    low[:12], high[:12] = -parameters.torque_limit, parameters.torque_limit
    return rows, low, high


def _solver(parameters: WholeBodyParameters, limits: int) -> proxsuite.proxqp.dense.QP:
    """Return a solver that stops in bounded time, and remembers nothing.

    It starts from the solution without inequalities, which mostly is the solution.
    Started from its previous result, it fails on 2 % of violent states.
    """
    proxqp = proxsuite.proxqp
    backend = proxqp.dense.DenseBackend.PrimalDualLDLT
    solver = proxqp.dense.QP(30, 18, limits, False, proxqp.dense.HessianType.Diagonal, backend)
    settings = solver.settings
    settings.eps_abs = parameters.tolerance
    settings.eps_rel = 0.0
    settings.check_duality_gap = True
    settings.eps_duality_gap_abs = parameters.tolerance
    settings.eps_duality_gap_rel = 0.0
    # Larger ones declare feasible problems infeasible.
    settings.eps_primal_inf = settings.eps_dual_inf = 1e-14
    settings.max_iter = parameters.max_iterations
    settings.max_iter_in = parameters.max_inner_iterations
    settings.initial_guess = proxqp.InitialGuess.EQUALITY_CONSTRAINED_INITIAL_GUESS
    settings.default_mu_eq = _EQUALITY_PENALTY
    return solver
