"""The bottom layer as it runs in the graph: from state, plan and forces to torques.

The whole-body controller's node and whoever repeats its ticks from a bag both use this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from layered_cbf_ros.interfaces import GroundForcePlan, PlannedMotion, RobotState
from layered_cbf_ros.plan_following import follow
from layered_cbf_ros.robot_model import RobotModel, yaw_of
from layered_cbf_ros.whole_body.lying import is_left_damped
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.whole_body_controller import (
    WholeBodyController,
    WholeBodyResult,
    WholeBodyState,
)


@dataclass(frozen=True, slots=True)
class TorqueMemory:
    """What one tick hands to the next.

    Attributes:
        feet: Their swings.
        last: The plan being followed.
        motion: What was followed at the tick's stamp.
        damped: Whether the robot lies, its joints only damped.
    """

    feet: WholeBodyState
    last: PlannedMotion
    motion: PlannedMotion
    damped: bool


class TorqueLayer:
    """Follows the safe motion and the planned forces of one robot.

    Its only memory is the solver's workspaces; all else is handed in and out.
    """

    def __init__(self, parameters: WholeBodyParameters) -> None:
        """Make the controller and its model."""
        self._parameters = parameters
        self._model = RobotModel(parameters.com_height)
        self._controller = WholeBodyController(parameters, self._model)

    def step(
        self,
        memory: TorqueMemory | None,
        state: RobotState,
        plan: PlannedMotion | None,
        forces: GroundForcePlan | None,
    ) -> tuple[TorqueMemory, WholeBodyResult]:
        """Return the torques at the stamp of a state.

        Args:
            memory: From the last tick; None at the first.
            state: Measured state.
            plan: The safe motion in force, None if the coordinator is silent.
            forces: The ground forces in force, None if the MPC is silent.

        Returns:
            The memory for the next tick, and the controller's result.
        """
        model, before = self._model, memory
        model.update_kinematics(state.configuration, state.velocity)
        followed = follow(
            None if before is None else before.last,
            state.stamp_ns,
            plan if forces is not None else None,  # without its gait a robot can only stand
            model.com[:2],
            yaw_of(model.rotation),
            self._parameters.braking,
        )
        motion = followed.motion
        if forces is None and plan is not None:
            motion = _at_height_of(plan, motion)
        damped = is_left_damped(
            before is not None and before.damped,
            None if before is None else before.motion,
            motion,
            float(model.com[2]),
            model.rotation,
            self._parameters,
        )
        if damped:
            result = self._controller.damp(state)
        else:
            feet = self._controller.start(state.stamp_ns) if before is None else before.feet
            result = self._controller.step(feet, state, motion, forces)
        return TorqueMemory(result.state, followed.last, motion, damped), result


def _at_height_of(plan: PlannedMotion, motion: PlannedMotion) -> PlannedMotion:
    """Return a motion at the height of a plan: who can only stand can also sit down."""
    there = plan.at(motion.stamp_ns)
    return replace(motion, height=there.height, vertical_velocity=there.vertical_velocity)
