"""The middle layer: ground reaction forces that make the robot follow its safe motion."""

from __future__ import annotations

import dataclasses
import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.ground_forces.condensed_qp import CondensedQp, QpSolution
from layered_cbf_ros.ground_forces.gait import Gait, GaitState, touch_downs
from layered_cbf_ros.ground_forces.mpc_inputs import MpcInputs
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.ground_forces.single_rigid_body import (
    RigidBody,
    SingleRigidBody,
    discretise,
    log_rotation,
)
from layered_cbf_ros.interfaces import (
    GRAVITY,
    NS_PER_S,
    TOE_RADIUS,
    Array,
    GroundForcePlan,
    PlannedMotion,
)
from layered_cbf_ros.rounding import rounded


class MpcStatus(enum.Enum):
    """How a tick went; anything but SOLVED means static forces."""

    SOLVED = 'solved'
    SOLVER_FAILED = 'solver failed'
    BAD_INPUT = 'input not finite'


@dataclass(frozen=True, slots=True)
class MpcState:
    """What one tick hands to the next: the gait, and the plan to linearise about."""

    gait: GaitState
    plan: GroundForcePlan


@dataclass(frozen=True, slots=True)
class MpcResult:
    """What one tick returns.

    Attributes:
        state: For the next tick.
        plan: For the whole-body controller; always finite. Its prediction is for one
            prediction step after the stamp.
        status: How the tick went.
        primal_residual: Largest violation of the force pyramid in the solution [N];
            infinite if nothing was solved.
    """

    state: MpcState
    plan: GroundForcePlan
    status: MpcStatus
    primal_residual: float


def static_forces(in_stance: NDArray[np.bool_], mass: float) -> Array:
    """Return forces that share the weight evenly among standing feet [N], (4, 3)."""
    forces = np.zeros((len(in_stance), 3))
    forces[in_stance, 2] = mass * GRAVITY / max(1, int(in_stance.sum()))
    return forces


class GroundForceMpc:
    """Linear MPC on the single rigid body (paper section III-E).

    Args:
        parameters: Of the middle layer.
        body: The robot.
    """

    def __init__(self, parameters: GroundForceParameters, body: RigidBody) -> None:
        self._parameters = parameters
        self._body = body
        # Amid its feet the CoM needs no steady acceleration to stay there.
        self._hip_offsets = body.hip_offsets - body.hip_offsets.mean(axis=0)
        self._dynamics = SingleRigidBody(body, feet=4)
        self._gait = Gait(parameters)
        self._qp = CondensedQp(parameters)
        step_ns = round(parameters.prediction_step * NS_PER_S)
        self._stage_ns = np.arange(parameters.horizon) * step_ns
        t = np.arange(1, parameters.horizon + 1) * parameters.prediction_step
        self._powers = np.column_stack((np.ones(len(t)), t, 0.5 * t * t))

    def start(self, stamp_ns: int) -> MpcState:
        """Return the state of a robot that stands still at the origin."""
        standing = np.ones(4, dtype=np.bool_)
        plan = GroundForcePlan(
            stamp_ns,
            static_forces(standing, self._body.mass),
            self._hip_offsets * (1.0, 1.0, 0.0) + (0.0, 0.0, TOE_RADIUS),
            np.zeros(4),
            np.zeros(4),
            np.zeros(12),
        )
        return MpcState(self._gait.start(stamp_ns), plan)

    def step(self, state: MpcState, inputs: MpcInputs) -> MpcResult:
        """Plan the forces of the feet that stand at the inputs' stamp.

        Args:
            state: From `start` or the last result; ticks may be missing between.
            inputs: What is measured and wanted.

        Returns:
            The forces, or static ones if the input or the solution is no good.
        """
        if not inputs.is_finite():
            return self._blind(state, inputs)
        reference = self._reference(inputs)
        slow = math.hypot(*reference.velocity) <= self._parameters.stop_speed
        gait = self._advance_gait(state.gait, inputs, slow)
        phase, rate = self._gait.swing(gait, inputs.stamp_ns)
        footholds = self._footholds(inputs, reference, phase, rate)
        in_stance = self._gait.in_stance(gait, inputs.stamp_ns + self._stage_ns)
        eta = self._present(inputs)
        model = discretise(
            self._dynamics.linearise(inputs.rotation, eta, footholds, state.plan.forces),
            self._parameters.prediction_step,
        )
        cost = self._qp.condense(model, eta, self._desired(inputs, reference), in_stance)
        solution = self._qp.solve(cost)
        forces = self._forces(solution, in_stance[0])
        predicted = model.after(eta, forces)
        plan = GroundForcePlan(inputs.stamp_ns, forces, footholds, phase, rate, predicted)
        status = MpcStatus.SOLVED if solution.solved else MpcStatus.SOLVER_FAILED
        return MpcResult(MpcState(gait, plan), plan, status, solution.primal_residual)

    def _blind(self, state: MpcState, inputs: MpcInputs) -> MpcResult:
        """Return static forces and the last footholds and prediction; the gait goes on."""
        stamp_ns = inputs.stamp_ns
        gait = self._advance_gait(state.gait, inputs, slow=True)
        phase, rate = self._gait.swing(gait, stamp_ns)
        forces = static_forces(rate == 0.0, self._body.mass)
        plan = dataclasses.replace(
            state.plan, stamp_ns=stamp_ns, forces=forces, swing_phase=phase, swing_rate=rate
        )
        return MpcResult(MpcState(gait, plan), plan, MpcStatus.BAD_INPUT, math.inf)

    def _reference(self, inputs: MpcInputs) -> PlannedMotion:
        """Return the motion to follow, at the inputs' stamp."""
        motion = inputs.motion
        if not inputs.halt:
            return motion.at(inputs.stamp_ns)
        braked = motion.braked(inputs.stamp_ns, self._parameters.braking)
        return dataclasses.replace(braked, vertical_velocity=motion.vertical_velocity)

    def _advance_gait(self, gait: GaitState, inputs: MpcInputs, slow: bool) -> GaitState:
        sits = inputs.motion.height != 0.0  # or stands up again
        stand = self._parameters.gait == 'stand' or sits or (inputs.halt and slow)
        return self._gait.advance(gait, inputs.stamp_ns, stand)

    def _present(self, inputs: MpcInputs) -> Array:
        """Return the present state eta, with xi = 0; (12,)."""
        eta = np.zeros(12)
        eta[0:3] = inputs.position
        eta[3:6] = inputs.velocity
        eta[9:12] = inputs.angular_velocity
        return eta

    def _desired(self, inputs: MpcInputs, reference: PlannedMotion) -> Array:
        """Return the states wanted after 1..N_h steps, (N_h, 12).

        The acceleration, the yaw rate and the vertical velocity of the reference are
        held constant, and the rotation vector grows by the yaw rate: to first order,
        as in the model.
        """
        cos, sin = math.cos(reference.yaw), math.sin(reference.yaw)
        heading = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        series = np.zeros((3, 12))  # of the desired state in powers of time
        series[0, 0:2] = reference.position
        series[0, 2] = inputs.height + reference.height
        series[0, 5] = series[1, 2] = reference.vertical_velocity
        series[0, 3:5] = series[1, 0:2] = reference.velocity
        series[0, 6:9] = log_rotation(inputs.rotation.T @ heading)
        series[0, 11] = series[1, 8] = reference.yaw_rate
        series[1, 3:5] = series[2, 0:2] = reference.acceleration
        return self._powers @ series

    def _footholds(
        self, inputs: MpcInputs, reference: PlannedMotion, phase: Array, rate: Array
    ) -> Array:
        """Return where feet stand, or will touch down, world [m], (4, 3).

        Feet land farther out, the farther or faster the body is off its reference
        (Raibert): that is what brings it back.
        """
        swings = rate > 0.0
        position, velocity = inputs.position[:2], inputs.velocity[:2]
        correction = self._parameters.position_gain * (position - reference.position)
        correction += self._parameters.raibert_gain * (velocity - reference.velocity)
        landing = touch_downs(
            position,
            velocity,
            correction,
            math.atan2(inputs.rotation[1, 0], inputs.rotation[0, 0]),
            reference.yaw_rate,
            self._hip_offsets,
            (1.0 - phase) * self._gait.swing_time,
            0.5 * self._gait.stance_time,
            TOE_RADIUS,
        )
        return np.where(swings[:, None], landing, inputs.feet)

    def _forces(self, solution: QpSolution, in_stance: NDArray[np.bool_]) -> Array:
        """Return the first step's forces, or static ones if there are none, (4, 3) [N]."""
        if not solution.solved:
            return static_forces(in_stance, self._body.mass)
        forces = np.zeros((4, 3))
        standing = in_stance.nonzero()[0]
        forces[standing] = solution.forces[: 3 * len(standing)].reshape(-1, 3)
        return rounded(forces, self._parameters.force_resolution)
