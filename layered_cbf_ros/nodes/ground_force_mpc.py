"""ground_force_mpc: one robot's middle layer; on states and its safe motion, plans forces."""

from __future__ import annotations

import time

from sensor_msgs.msg import JointState

from layered_cbf_ros.ground_forces.force_layer import ForceLayer
from layered_cbf_ros.ground_forces.ground_force_mpc import MpcStatus
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.messages.ground_forces import GroundForceWriter
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.node_topics import STATE
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import plan_input
from layered_cbf_ros.nodes.running import run_node


class GroundForceMpcNode(GraphNode):
    """Wires states and plans to the MPC, and its forces to the whole-body controller."""

    def __init__(self) -> None:
        super().__init__('ground_force_mpc')
        robot = self.get_namespace().strip('/')
        self._layer = ForceLayer(declare(self, GroundForceParameters))
        self._state = StateReader(robot)
        self._plan = plan_input(self, robot)
        estimated = self.state_topic != STATE  # then the estimator hears the gait, too
        self._forces = self.writer(JointState, 'ground_forces', 1 + estimated)
        self._encoder = GroundForceWriter()

    def run(self) -> None:
        """Plan forces on every state that is due."""
        memory = None
        for data in self.ticks(self.timing.plan_ns):
            state = self.accept(self._state.read, data)
            if state is None:
                continue
            plan = self._plan.at(state.stamp_ns)
            begun_ns = time.perf_counter_ns()
            memory, result = self._layer.step(memory, state, plan)
            self._forces.publish(self._encoder.encode(result.plan))
            self.statistics.solver_failures += result.status is not MpcStatus.SOLVED
            self.statistics.tick(time.perf_counter_ns() - begun_ns)


def main() -> None:
    """Run the node."""
    run_node(GroundForceMpcNode)
