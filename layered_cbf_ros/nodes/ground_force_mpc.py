"""ground_force_mpc: one robot's middle layer; on states and its safe motion, plans forces."""

from __future__ import annotations

import time

import numpy as np
from sensor_msgs.msg import JointState

from layered_cbf_ros.ground_forces.ground_force_mpc import GroundForceMpc, MpcInputs, MpcStatus
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.ground_forces.single_rigid_body import RigidBody
from layered_cbf_ros.interfaces import PlannedMotion, RobotState
from layered_cbf_ros.messages.ground_forces import GroundForceWriter
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import plan_input
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.plan_following import PlanFollower
from layered_cbf_ros.robot_model import RobotModel, yaw_of


class GroundForceMpcNode(GraphNode):
    """Wires states and plans to the MPC, and its forces to the whole-body controller."""

    def __init__(self) -> None:
        super().__init__('ground_force_mpc')
        robot = self.get_namespace().strip('/')
        parameters = declare(self, GroundForceParameters)
        self._height = parameters.com_height
        self._model = RobotModel(parameters.com_height)
        body = RigidBody(self._model.mass, self._model.inertia, self._model.hip_offsets)
        self._mpc = GroundForceMpc(parameters, body)
        self._state = StateReader(robot)
        self._plan = plan_input(self, robot)
        self._follower = PlanFollower(parameters.braking)
        self._forces = self.writer(JointState, 'ground_forces')
        self._encoder = GroundForceWriter()

    def run(self) -> None:
        """Plan forces on every state that is due."""
        memory = None
        for data in self.ticks(self.timing.plan_ns):
            state = self.accept(self._state.read, data)
            if state is None:
                continue
            plan = self._plan.at(state.stamp_ns)
            memory = memory or self._mpc.start(state.stamp_ns)
            begun_ns = time.perf_counter_ns()
            self._model.update_kinematics(state.configuration, state.velocity)
            motion, halt = self._follower.follow(
                state.stamp_ns, plan, self._model.com[:2], yaw_of(self._model.rotation)
            )
            result = self._mpc.step(memory, self._inputs(state, motion, halt))
            memory = result.state
            self._forces.publish(self._encoder.encode(result.plan))
            self.statistics.solver_failures += result.status is not MpcStatus.SOLVED
            self.statistics.tick(time.perf_counter_ns() - begun_ns)

    def _inputs(self, state: RobotState, motion: PlannedMotion, halt: bool) -> MpcInputs:
        model = self._model
        return MpcInputs(
            stamp_ns=state.stamp_ns,
            position=np.array(model.com),
            velocity=np.array(model.com_velocity),
            rotation=np.array(model.rotation),
            angular_velocity=state.velocity[3:6],
            feet=model.feet,
            motion=motion,
            height=self._height,
            halt=halt,
        )


def main() -> None:
    """Run the node."""
    run_node(GroundForceMpcNode)
