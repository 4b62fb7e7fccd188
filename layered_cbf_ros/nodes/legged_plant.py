"""The simulated A1s with their topics: states out, joint commands in."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState

from layered_cbf_ros.interfaces import JOINT_NAMES, NS_PER_S, Array, RobotState
from layered_cbf_ros.messages import standard
from layered_cbf_ros.messages.joint_state import JointStateReader
from layered_cbf_ros.messages.measured import MeasuredWriter
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.node_topics import measured
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.simulator_outputs import SimulatorOutputs, latch
from layered_cbf_ros.nodes.transport import Writer
from layered_cbf_ros.plants.bullet_world import STEP_NS, BulletWorld
from layered_cbf_ros.plants.emulation.sensors import Sensors
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_description import robot_description
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import ESTIMATOR, Scenario

POLL_NS = 80_000  # only the simulator polls: more pollers would starve each other
PEOPLE_NS = NS_PER_S // 50


class LeggedPlant:
    """Steps the A1s of a scenario with the torques of their controllers."""

    def __init__(self, node: GraphNode, scenario: Scenario) -> None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the physics engine talks to itself
        self._names = names = [robot.name for robot in scenario.robots]
        model = RobotModel()
        starts = [
            model.nominal_configuration(np.array(robot.position), robot.yaw)
            for robot in scenario.robots
        ]
        self._world = BulletWorld(scenario, declare(node, SimulatorParameters), starts)
        self._steps = node.timing.tick_ns // STEP_NS
        estimated = scenario.states == ESTIMATOR
        self._state = node.writer(
            JointState, node.state_topic, 0 if estimated else 2 * len(names) + 1
        )
        self._sensors = _sensors(node, scenario) if estimated else []
        self._encoder = StateWriter(names)
        self._commands = [
            Input(
                node,
                node.reader(JointState, f'/{name}/joint_commands'),
                node.rules.command,
                JointStateReader(JOINT_NAMES).read,
                f'/{name}/whole_body_controller',
                POLL_NS,
            )
            for name in names
        ]
        self._torques = np.zeros((len(names), len(JOINT_NAMES)))
        self._silent: list[int] = []
        self._outputs = SimulatorOutputs(node, scenario, self._world)
        kinds = (
            ('joint_states', JointState), ('imu', Imu), ('foot_contacts', JointState),
            *(() if estimated else (('odom', Odometry),)),
        )  # fmt: skip
        self._people = [
            [node.writer(kind, f'/{name}/{topic}', 0) for topic, kind in kinds] for name in names
        ]
        urdf = robot_description()
        self._latched = [latch(node, f'/{name}/robot_description', urdf) for name in names]

    @property
    def stamp_ns(self) -> int:
        """Time of the present state [ns]."""
        return self._world.stamp_ns

    def publish(self) -> Sequence[Array]:
        """Publish what is due now; return where each trunk is in the plane [m], (2,)."""
        states = self._world.states()
        self._state.publish(self._encoder.encode(states))
        self._publish_sensors(states)
        self._outputs.publish(self.stamp_ns)
        if self.stamp_ns % PEOPLE_NS == 0:
            self._publish_people(states)
        return [state.configuration[:2] for state in states]

    def hear(self) -> None:
        """Take the commanded torques [Nm], and note who sent none to act on."""
        self._torques = np.zeros_like(self._torques)
        self._silent = []
        for i, command in enumerate(self._commands):
            received = command.at(self.stamp_ns)
            if received is not None:
                self._torques[i] = received[1][2]
            elif self.stamp_ns:
                self._silent.append(i)

    def advance(self) -> None:
        """Go on by one tick; whoever is silent is damped."""
        for _ in range(self._steps):
            for robot in self._silent:
                self._world.damp(robot)
            self._world.step(self._torques)

    def _publish_sensors(self, states: Sequence[RobotState]) -> None:
        """Tell the estimators what their robots' sensors read."""
        for i, (sensors, writer, encoder) in enumerate(self._sensors):
            writer.publish(encoder.encode(sensors.read(states[i], self._world.imu(i))))

    def _publish_people(self, states: Sequence[RobotState]) -> None:
        for i, (state, writers) in enumerate(zip(states, self._people, strict=True)):
            name, reading = self._names[i], self._world.imu(i)
            told = reading.orientation, reading.angular_velocity, reading.specific_force
            messages = (
                standard.joint_states(state),
                standard.imu(name, state.stamp_ns, *told),
                standard.foot_contacts(state),
                standard.odometry(name, state),
            )
            for writer, message in zip(writers, messages, strict=False):
                writer.publish(serialize_message(message))


def _sensors(node: GraphNode, scenario: Scenario) -> list[tuple[Sensors, Writer, MeasuredWriter]]:
    """Return each robot's sensors, and what sends and encodes their readings."""
    return [
        (
            Sensors(scenario.emulation, np.random.default_rng((scenario.seed, k))),
            node.writer(JointState, measured(robot.name)),
            MeasuredWriter(robot.name),
        )
        for k, robot in enumerate(scenario.robots)
    ]
