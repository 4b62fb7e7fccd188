"""The bottom layer as it runs in the graph: from state, plan and forces to torques.

The whole-body controller's node and whoever repeats its ticks from a bag both use this.
"""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.interfaces import GroundForcePlan, PlannedMotion, RobotState
from layered_cbf_ros.plan_following import follow
from layered_cbf_ros.robot_model import RobotModel, yaw_of
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.whole_body_controller import (
    WholeBodyController,
    WholeBodyResult,
    WholeBodyState,
)


@dataclass(frozen=True, slots=True)
class TorqueMemory:
    """What one tick hands to the next: the feet's swings, and the plan being followed."""

    feet: WholeBodyState
    last: PlannedMotion


class TorqueLayer:
    """Follows the safe motion and the planned forces of one robot.

    Its only memory is the solver's workspaces; all else is handed in and out.
    """

    def __init__(self, parameters: WholeBodyParameters) -> None:
        """Make the controller and its model."""
        self._braking = parameters.braking
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
        model = self._model
        feet = self._controller.start(state.stamp_ns) if memory is None else memory.feet
        if forces is None:
            plan = None  # without its gait a robot can only stand
        if plan is None:
            model.update_kinematics(state.configuration, state.velocity)
        followed = follow(
            None if memory is None else memory.last,
            state.stamp_ns,
            plan,
            model.com[:2],
            yaw_of(model.rotation),
            self._braking,
        )
        result = self._controller.step(feet, state, followed.motion, forces)
        return TorqueMemory(result.state, followed.last), result
