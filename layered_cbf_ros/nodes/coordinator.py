"""coordinator: the top layer; on states and tracks, one safe motion for every robot."""

from __future__ import annotations

import time

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from layered_cbf_ros.coordination.coordination_layer import (
    CoordinationLayer,
    axis_names,
    barriers,
    interventions,
    wishes,
)
from layered_cbf_ros.coordination.exchange import CoordinationResult
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.messages.standard import named_values, series
from layered_cbf_ros.messages.trajectory import TrajectoryWriter
from layered_cbf_ros.node_topics import BALLS, BARRIERS, DESIRED, INTERVENTION, PLAN
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.track_input import TrackInput
from layered_cbf_ros.scenario_file import load_scenario

BATCH = 20  # ticks told in one message: full rate at 50 messages a second

BALL = ('q_x', 'q_y', 'r')


class CoordinatorNode(GraphNode):
    """Wires states and tracks to the coordinator, and its plan to all robots."""

    def __init__(self) -> None:
        super().__init__('coordinator')
        self._scenario = scenario = load_scenario(self.scenario)
        self._names = [robot.name for robot in scenario.robots]
        parameters = declare(self, CoordinatorParameters)
        self._layer = CoordinationLayer(
            parameters, scenario.robots, scenario.walls, self.timing.state_rate
        )
        self._states = [StateReader(name) for name in self._names]
        self._tracks = TrackInput(self, scenario) if scenario.obstacles else None
        self._plan = self.writer(MultiDOFJointTrajectory, PLAN, 2 * len(self._names))
        self._encoder = TrajectoryWriter(self._names)
        self._barriers = self.writer(JointTrajectory, BARRIERS, 0)
        self._intervention = self.writer(JointTrajectory, INTERVENTION, 0)
        self._desired = self.writer(JointTrajectory, DESIRED, 0)
        self._axes = axis_names(self._names)
        self._balls = self.writer(JointState, BALLS, 0)
        self._batch: list[CoordinationResult] = []

    def close(self) -> None:
        """Tell also the ticks of a batch that isn't full."""
        if self._batch:
            self._publish_batch()
        super().close()

    def run(self) -> None:
        """Plan on every state."""
        memory = None
        for data in self.ticks(self.timing.tick_ns):
            states = [self.accept(reader.read, data) for reader in self._states]
            known = [state for state in states if state is not None]
            if not known:
                continue
            stamp_ns = known[0].stamp_ns
            tracks = self._tracks.at(stamp_ns) if self._tracks is not None else ()
            begun_ns = time.perf_counter_ns()
            result = self._layer.step(memory, stamp_ns, states, tracks)
            memory = result.state
            if stamp_ns % self.timing.plan_ns == 0 or not self.lockstep:
                self._plan.publish(self._encoder.encode(stamp_ns, result.motions))
            self._count(result, states.count(None), time.perf_counter_ns() - begun_ns)
            self._tell(result)

    def _count(self, result: CoordinationResult, unknown: int, solve_ns: int) -> None:
        """Count what happened; states that are unknown were counted when they were refused."""
        self.statistics.solver_failures += result.solver_failed
        self.statistics.slack_events += result.slack_event
        self.statistics.rejected += result.rejected - unknown
        self.statistics.tick(solve_ns)

    def _tell(self, result: CoordinationResult) -> None:
        """Publish the barriers, in batches of ticks with the same pairs."""
        if self._batch and self._batch[0].labels != result.labels:
            self._publish_batch()
        self._batch.append(result)
        if len(self._batch) == BATCH:
            self._publish_batch()

    def _publish_batch(self) -> None:
        batch, self._batch = self._batch, []
        last = batch[-1]
        frozen = [name for name, held in zip(self._names, last.alarms, strict=True) if held]
        self.statistics.details = {
            'qp_status': last.status.name.lower(),
            'frozen': ', '.join(frozen),
            'tracks_left_out': str(last.tracks_left_out),
        }
        stamps = [result.motions[0].stamp_ns for result in batch]
        changes = [interventions(r) for r in batch]
        self._intervention.publish(serialize_message(series(self._names, stamps, changes)))
        asked = [wishes(r) for r in batch]
        self._desired.publish(serialize_message(series(self._axes, stamps, asked)))
        if last.labels:
            rows = [barriers(r) for r in batch]
            self._barriers.publish(serialize_message(series(last.labels, stamps, rows)))
        if last.ball_labels:
            names = [f'{label}/{axis}' for label in last.ball_labels for axis in BALL]
            values = np.column_stack((last.q, last.r)).ravel()
            self._balls.publish(serialize_message(named_values(stamps[-1], names, values)))


def main() -> None:
    """Run the node."""
    run_node(CoordinatorNode)
