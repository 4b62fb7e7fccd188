"""The middle layer as it runs in the graph: from a robot's state and plan to its forces.

The MPC's node and whoever repeats its ticks from a bag both use this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.ground_forces.ground_force_mpc import (
    GroundForceMpc,
    MpcResult,
    MpcState,
)
from layered_cbf_ros.ground_forces.mpc_inputs import MpcInputs
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.ground_forces.single_rigid_body import RigidBody
from layered_cbf_ros.interfaces import PlannedMotion, RobotState
from layered_cbf_ros.plan_following import Followed, follow
from layered_cbf_ros.robot_model import RobotModel, yaw_of


@dataclass(frozen=True, slots=True)
class ForceMemory:
    """What one tick hands to the next: the MPC's state, and the plan being followed."""

    mpc: MpcState
    last: PlannedMotion


class ForceLayer:
    """Follows the safe motion of one robot with the MPC.

    Its only memory is the solver's workspaces; all else is handed in and out.
    """

    def __init__(self, parameters: GroundForceParameters) -> None:
        """Make the MPC for the robot's nominal pose."""
        self._parameters = parameters
        self._model = RobotModel(parameters.com_height)
        body = RigidBody(self._model.mass, self._model.inertia, self._model.hip_offsets)
        self._mpc = GroundForceMpc(parameters, body)

    def step(
        self, memory: ForceMemory | None, state: RobotState, plan: PlannedMotion | None
    ) -> tuple[ForceMemory, MpcResult]:
        """Plan the forces at the stamp of a state.

        Args:
            memory: From the last tick; None at the first.
            state: Measured state.
            plan: The safe motion in force, None if the coordinator is silent.

        Returns:
            The memory for the next tick, and the MPC's result.
        """
        model = self._model
        mpc = self._mpc.start(state.stamp_ns) if memory is None else memory.mpc
        model.update_kinematics(state.configuration, state.velocity)
        followed = follow(
            None if memory is None else memory.last,
            state.stamp_ns,
            plan,
            model.com[:2],
            yaw_of(model.rotation),
            self._parameters.braking,
        )
        result = self._mpc.step(mpc, self._inputs(state, followed))
        return ForceMemory(result.state, followed.last), result

    def _inputs(self, state: RobotState, followed: Followed) -> MpcInputs:
        model = self._model
        return MpcInputs(
            stamp_ns=state.stamp_ns,
            position=np.array(model.com),
            velocity=np.array(model.com_velocity),
            rotation=np.array(model.rotation),
            angular_velocity=state.velocity[3:6],
            feet=model.feet,
            motion=followed.motion,
            height=self._parameters.com_height,
            halt=followed.halt,
        )
