"""What the simulator publishes of every plant: time, clearances, detections, the scenario."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np
from geometry_msgs.msg import PoseArray
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages import standard
from layered_cbf_ros.node_topics import CLEARANCE, DETECTIONS, SCENARIO, TRUTH
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.scripted_operator import ScriptedOperator
from layered_cbf_ros.nodes.transport import latched
from layered_cbf_ros.plants.clearance_report import ClearanceReport
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import to_json

CLOCK_NS = NS_PER_S // 100


class World(Protocol):
    """What is measured of any plant."""

    def clearances(self) -> ClearanceReport:
        """Return how close all pairs are."""

    def obstacle_positions(self) -> Array:
        """Return the true centre of each obstacle [m], (M, 2)."""


class SimulatorOutputs:
    """Publishes each topic at its own rate, counted in simulated time."""

    def __init__(self, node: GraphNode, scenario: Scenario, world: World) -> None:
        self._scenario, self._world = scenario, world
        self._timing = node.timing
        self._rng = np.random.default_rng(scenario.seed)
        self._delayed: deque[bytes] = deque()
        self._clock = node.create_publisher(Clock, '/clock', 10)
        self._clearance = node.writer(JointState, CLEARANCE, 0)
        self._operator = ScriptedOperator(node, scenario) if scenario.operator else None
        if scenario.obstacles:
            self._truth = node.writer(PoseArray, TRUTH, 0)
            self._detections = node.writer(PoseArray, DETECTIONS)
        self._latched = latch(node, SCENARIO, to_json(scenario))

    def publish(self, stamp_ns: int) -> None:
        """Publish what is due at a stamp [ns]."""
        if self._operator is not None:
            self._operator.publish(stamp_ns)
        if stamp_ns % CLOCK_NS == 0:
            self._clock.publish(standard.clock(stamp_ns))
            self._publish_clearance()
        if self._scenario.obstacles and stamp_ns % self._timing.detection_ns == 0:
            self._publish_obstacles(stamp_ns)

    def _publish_clearance(self) -> None:
        report = self._world.clearances()
        message = standard.named_values(
            report.stamp_ns, report.labels, report.distances, effort=report.forces
        )
        self._clearance.publish(serialize_message(message))

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


def latch(node: GraphNode, topic: str, text: str) -> object:
    """Publish a text once; late joiners get it too. Returns what must be kept alive."""
    publisher = node.create_publisher(String, topic, latched())
    publisher.publish(String(data=text))
    return publisher
