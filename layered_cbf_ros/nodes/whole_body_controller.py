"""whole_body_controller: one robot's bottom layer; on each state, torques for its joints."""

from __future__ import annotations

import time

import numpy as np
from sensor_msgs.msg import JointState

from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.messages.ground_forces import GroundForceReader
from layered_cbf_ros.messages.joint_state import JointStateWriter
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input, plan_input
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.torque_layer import TorqueLayer


class WholeBodyControllerNode(GraphNode):
    """Wires states, plans and forces to the controller, and its torques to the plant."""

    def __init__(self) -> None:
        super().__init__('whole_body_controller')
        robot = self.get_namespace().strip('/')
        self._layer = TorqueLayer(declare(self, WholeBodyParameters))
        self._state = StateReader(robot)
        self._plan = plan_input(self, robot)
        self._forces = Input(
            self,
            self.reader(JointState, 'ground_forces'),
            self.rules.forces,
            GroundForceReader().read,
            f'/{robot}/ground_force_mpc',
        )
        self._commands = self.writer(JointState, 'joint_commands')
        self._encoder = JointStateWriter(JOINT_NAMES)

    def run(self) -> None:
        """Send torques on every state."""
        memory = None
        zeros = np.zeros(len(JOINT_NAMES))
        for data in self.ticks(self.timing.tick_ns):
            state = self.accept(self._state.read, data)
            if state is None:
                continue
            plan, forces = self._plan.at(state.stamp_ns), self._forces.at(state.stamp_ns)
            begun_ns = time.perf_counter_ns()
            memory, result = self._layer.step(memory, state, plan, forces)
            self._commands.publish(
                self._encoder.encode(state.stamp_ns, zeros, zeros, result.torques)
            )
            self.statistics.solver_failures += not result.solved
            self.statistics.tick(time.perf_counter_ns() - begun_ns)


def main() -> None:
    """Run the node."""
    run_node(WholeBodyControllerNode)
