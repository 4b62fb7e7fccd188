"""What the simulator publishes besides the states: detections, and topics for people."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from layered_cbf_ros.interfaces import NS_PER_S, RobotState
from layered_cbf_ros.messages import standard
from layered_cbf_ros.node_topics import CLEARANCE, DETECTIONS, SCENARIO, TRUTH
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.transport import latched
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.robot_model import find_urdf
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import to_json

CLOCK_NS = NS_PER_S // 100
PEOPLE_NS = NS_PER_S // 50


class SimulatorOutputs:
    """Publishes each topic at its own rate, counted in simulated time."""

    def __init__(self, node: GraphNode, scenario: Scenario, world: BulletWorld) -> None:
        self._scenario, self._world = scenario, world
        self._timing = node.timing
        self._rng = np.random.default_rng(scenario.seed)
        self._delayed: deque[bytes] = deque()
        self._clock = node.create_publisher(Clock, '/clock', 10)
        self._clearance = node.writer(JointState, CLEARANCE, 0)
        if scenario.obstacles:
            self._truth = node.writer(PoseArray, TRUTH, 0)
            self._detections = node.writer(PoseArray, DETECTIONS)
        self._people = []
        for robot in scenario.robots:
            kinds = ('joint_states', JointState), ('odom', Odometry), ('imu', Imu)
            self._people.append(
                [node.writer(kind, f'/{robot.name}/{topic}', 0) for topic, kind in kinds]
                + [node.writer(JointState, f'/{robot.name}/foot_contacts', 0)]
            )
        self._latched = [
            _latch(node, f'/{robot.name}/robot_description', find_urdf().read_text())
            for robot in scenario.robots
        ]
        self._latched.append(_latch(node, SCENARIO, to_json(scenario)))

    def publish(self, states: Sequence[RobotState]) -> None:
        """Publish what is due at the states' stamp."""
        stamp_ns = states[0].stamp_ns
        if stamp_ns % CLOCK_NS == 0:
            self._clock.publish(standard.clock(stamp_ns))
            self._publish_clearance()
        if stamp_ns % PEOPLE_NS == 0:
            self._publish_people(states)
        if self._scenario.obstacles and stamp_ns % self._timing.detection_ns == 0:
            self._publish_obstacles(stamp_ns)

    def _publish_clearance(self) -> None:
        report = self._world.clearances()
        message = standard.named_values(
            report.stamp_ns, report.labels, report.distances, effort=report.forces
        )
        self._clearance.publish(serialize_message(message))

    def _publish_people(self, states: Sequence[RobotState]) -> None:
        for i, (state, writers) in enumerate(zip(states, self._people, strict=True)):
            name = self._scenario.robots[i].name
            reading = self._world.imu(i)
            measured = reading.orientation, reading.angular_velocity, reading.specific_force
            messages = (
                standard.joint_states(state),
                standard.odometry(name, state),
                standard.imu(name, state.stamp_ns, *measured),
                standard.foot_contacts(state),
            )
            for writer, message in zip(writers, messages, strict=True):
                writer.publish(serialize_message(message))

    def _publish_obstacles(self, stamp_ns: int) -> None:
        """Publish where obstacles are, and what a sensor would have seen of them."""
        truth = self._world.obstacle_positions()
        self._truth.publish(serialize_message(standard.points(stamp_ns, truth)))
        sensor = self._scenario.world.detections
        seen = truth + self._rng.normal(0.0, sensor.noise, truth.shape)
        seen = seen[self._rng.random(len(truth)) >= sensor.dropout]
        self._delayed.append(serialize_message(standard.points(stamp_ns, seen)))
        if len(self._delayed) > self._timing.detection_delay_periods:
            self._detections.publish(self._delayed.popleft())


def _latch(node: GraphNode, topic: str, text: str) -> object:
    """Publish a text once; late joiners get it too."""
    publisher = node.create_publisher(String, topic, latched())
    publisher.publish(String(data=text))
    return publisher
