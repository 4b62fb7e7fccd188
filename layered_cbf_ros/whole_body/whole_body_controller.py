"""Whole-body controller: joint torques from the planned motion and forces, paper III-F."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import (
    GRAVITY,
    NS_PER_S,
    Array,
    GroundForcePlan,
    PlannedMotion,
    RobotState,
)
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.rounding import rounded
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


@dataclass(frozen=True, slots=True)
class WholeBodyState:
    """What the controller knows of the feet from one tick to the next.

    Attributes:
        stamp_ns: Time it is for [ns].
        lift_off: Where each foot's latest swing began, world [m], (4, 3).
        footholds, swing_phase, swing_rate: As in GroundForcePlan.
    """

    stamp_ns: int
    lift_off: Array
    footholds: Array
    swing_phase: Array
    swing_rate: Array


@dataclass(frozen=True, slots=True)
class WholeBodyResult:
    """Outcome of one tick.

    Attributes:
        state: For the next tick.
        torques: Joint torques [Nm], (12,).
        forces: Ground reaction forces that go with them, world [N], (4, 3).
        error: Virtual constraints y: CoM [m] (3), orientation [rad] (3), swing
            feet [m] (12); (18,).
        status: The solver's word for the outcome.
        solved: False if the torques are the fallback's.
    """

    state: WholeBodyState
    torques: Array
    forces: Array
    error: Array
    status: str
    solved: bool


class WholeBodyController:
    """Virtual constraints on the full dynamics, as a quadratic program."""

    def __init__(self, parameters: WholeBodyParameters, model: RobotModel) -> None:
        """Make and warm the solvers; the model is this controller's from now on."""
        self._parameters = parameters
        self._model = model
        self._constraints = VirtualConstraints(parameters)
        self._curve = SwingCurve(parameters.step_height)
        self._qp = TorqueQp(parameters, model)

    def start(self, stamp_ns: int) -> WholeBodyState:
        """Return the state of a robot that stands on all feet."""
        nowhere = np.zeros((4, 3))
        return WholeBodyState(stamp_ns, nowhere, nowhere, np.zeros(4), np.zeros(4))

    def step(
        self,
        state: WholeBodyState,
        robot: RobotState,
        motion: PlannedMotion,
        plan: GroundForcePlan | None,
    ) -> WholeBodyResult:
        """Return the torques that follow a motion with level trunk.

        Args:
            state: From the previous tick.
            robot: Measured state.
            motion: Planned motion at the robot's stamp.
            plan: Latest plan of the ground forces, at most a few ms old, or None
                if there is none: then feet in the air are put down, and all
                feet in stance carry the robot evenly.
        """
        body = level_body(motion, self._parameters.com_height)
        if motion.height < 0.0:
            self._model.update_kinematics(robot.configuration, robot.velocity)
            body = sitting_body(body, motion, self._model.feet)
        return self.track(state, robot, body, plan)

    def track(
        self,
        state: WholeBodyState,
        robot: RobotState,
        body: BodyReference,
        plan: GroundForcePlan | None,
    ) -> WholeBodyResult:
        """Return the torques that follow any motion of the body; see step."""
        self._model.update(robot.configuration, robot.velocity)
        present = follow_plan(state, robot.stamp_ns, plan, self._model.feet)
        feet = self._feet(present)
        outputs = self._constraints.outputs(self._model, robot.velocity, body, feet)
        stance = present.swing_rate == 0.0
        forces = self._even_forces(stance) if plan is None else plan.forces
        solution = self._qp.solve(tuple(stance.tolist()), outputs.acceleration, forces)
        if solution.solved:
            torques = rounded(solution.torques, self._parameters.torque_resolution)
        else:
            torques = self._damping(robot)
        return WholeBodyResult(
            # An input that isn't a number must not live on in the state.
            present if math.isfinite(solution.residual) else state,
            torques,
            solution.forces,
            outputs.error,
            solution.status,
            solution.solved,
        )

    def damp(self, robot: RobotState) -> WholeBodyResult:
        """Return torques that only damp the joints; all feet count as standing."""
        feet, torques = self.start(robot.stamp_ns), self._damping(robot)
        return WholeBodyResult(feet, torques, np.zeros((4, 3)), np.zeros(18), 'DAMPED', True)

    def _damping(self, robot: RobotState) -> Array:
        limits = self._parameters.joint_damping, self._parameters.torque_limit
        return damping_torques(robot.velocity[6:], *limits)

    def _feet(self, state: WholeBodyState) -> FeetReference:
        """Return the desired motion of the swing feet."""
        curve = self._curve.at(state.lift_off, state.footholds, state.swing_phase, state.swing_rate)
        return FeetReference((state.swing_rate > 0.0).astype(np.float64), *curve)

    def _even_forces(self, stance: NDArray[np.bool_]) -> Array:
        """Return the robot's weight shared evenly by the stance feet [N], (4, 3)."""
        forces = np.zeros((4, 3))
        forces[stance, 2] = self._model.mass * GRAVITY / max(1, int(stance.sum()))
        return forces


def follow_plan(
    state: WholeBodyState, stamp_ns: int, plan: GroundForcePlan | None, feet: Array
) -> WholeBodyState:
    """Bring the swings to a stamp, by the plan or, without one, as they were going.

    A swing whose phase reaches 1 ends in stance, whatever an older plan says.

    Args:
        state: From the previous tick.
        stamp_ns: Time to bring the swings to [ns].
        plan: Latest plan, or None.
        feet: Present toe centres: the lift-off positions of swings that begin [m], (4, 3).
    """
    source = state if plan is None else plan
    elapsed = (stamp_ns - source.stamp_ns) / NS_PER_S
    phase = source.swing_phase + source.swing_rate * elapsed
    swinging = (source.swing_rate > 0.0) & (phase < 1.0)
    begins = swinging & (state.swing_rate == 0.0)
    return WholeBodyState(
        stamp_ns,
        np.where(begins[:, None], feet, state.lift_off),
        source.footholds,
        np.where(swinging, phase, 0.0),
        np.where(swinging, source.swing_rate, 0.0),
    )


def damping_torques(joint_velocity: Array, damping: float, limit: float) -> Array:
    """Return torques against the joint velocities, for when nothing better is known.

    Args:
        joint_velocity: [rad/s], (12,); a joint without a finite one gets no torque.
        damping: [Nms/rad].
        limit: Largest torque [Nm].
    """
    return np.nan_to_num(np.clip(-damping * joint_velocity, -limit, limit), nan=0.0)
