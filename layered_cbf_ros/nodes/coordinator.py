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
from layered_cbf_ros.coordination.fleet_parameters import FleetParameters
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.messages.standard import named_values, series
from layered_cbf_ros.messages.trajectory import TrajectoryWriter
from layered_cbf_ros.node_topics import BALLS, BARRIERS, COMMANDS, DESIRED, INTERVENTION, PLAN
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.fleet_states import FleetStates
from layered_cbf_ros.nodes.operator_input import OperatorInput
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.scenario_node import ScenarioNode
from layered_cbf_ros.nodes.team_states import LeggedStates, TeamStates
from layered_cbf_ros.nodes.track_input import TrackInput
from layered_cbf_ros.nodes.wired_states import WiredStates
from layered_cbf_ros.operation.orders import Orders
from layered_cbf_ros.operation.parameters import JoystickParameters
from layered_cbf_ros.operation.told import told, told_names
from layered_cbf_ros.scenario import BASES, ESTIMATOR

TELLING_RATE = 50  # messages a second that tell of the ticks; each tells several

BALL = ('q_x', 'q_y', 'r')


class CoordinatorNode(ScenarioNode):
    """Wires states and tracks to the coordinator, and its plan to all robots."""

    def __init__(self) -> None:
        super().__init__('coordinator')
        scenario = self._scenario
        self._names = [robot.name for robot in scenario.robots]
        parameters = declare(self, CoordinatorParameters)
        limits = parameters.desired_speed, parameters.yaw_rate_limit
        self._operator = OperatorInput(self, scenario, declare(self, JoystickParameters), limits)
        self._layer = CoordinationLayer(
            parameters, scenario.robots, scenario.walls, self.timing.state_rate
        )
        fleet = declare(self, FleetParameters)
        has_legs = scenario.plant != BASES
        self._states: TeamStates = (
            FleetStates(self, scenario, fleet, parameters)
            if not has_legs
            else WiredStates(self, self._names)
            if scenario.states == ESTIMATOR
            else LeggedStates(self, self._names)
        )
        self._tracks = TrackInput(self, scenario) if scenario.obstacles else None
        self._plan = self.writer(MultiDOFJointTrajectory, PLAN, 2 * len(self._names) * has_legs)
        self._encoder = TrajectoryWriter(self._names)
        self._barriers = self.writer(JointTrajectory, BARRIERS, 0)
        self._intervention = self.writer(JointTrajectory, INTERVENTION, 0)
        self._desired = self.writer(JointTrajectory, DESIRED, 0)
        self._axes = axis_names(self._names)
        self._balls = self.writer(JointState, BALLS, 0)
        self._commands = self.writer(JointTrajectory, COMMANDS, 0)
        self._asked = told_names(self._names)
        self._batch: list[CoordinationResult] = []
        self._orders: list[Orders] = []
        self._was_asked = False

    def close(self) -> None:
        """Tell also the ticks of a batch that isn't full."""
        if self._batch:
            self._publish_batch()
        super().close()

    def run(self) -> None:
        """Plan on every state."""
        memory = None
        for stamp_ns in self._states.ticks():
            tracks = self._tracks.at(stamp_ns) if self._tracks is not None else ()
            orders = self._operator.at(stamp_ns)
            begun_ns = time.perf_counter_ns()
            inputs = self._states.inputs(self._layer, tracks, orders)
            result = self._layer.act(memory, inputs)
            memory = result.state
            if stamp_ns % self.timing.plan_ns == 0 or not self.lockstep:
                self._plan.publish(self._encoder.encode(stamp_ns, result.motions))
            self._states.answer(result)
            self._count(result, time.perf_counter_ns() - begun_ns)
            self._tell(result, orders)

    def _count(self, result: CoordinationResult, solve_ns: int) -> None:
        """Count what happened; states that are unknown were counted when they were refused."""
        self.statistics.solver_failures += result.solver_failed
        self.statistics.slack_events += result.slack_event
        self.statistics.rejected += result.rejected - self._states.unknown
        self.statistics.tick(solve_ns)

    def _tell(self, result: CoordinationResult, orders: Orders) -> None:
        """Publish the barriers, in batches of ticks with the same pairs."""
        if self._batch and self._batch[0].labels != result.labels:
            self._publish_batch()
        self._batch.append(result)
        self._orders.append(orders)
        if len(self._batch) >= self.timing.state_rate // TELLING_RATE:
            self._publish_batch()

    def _publish_batch(self) -> None:
        batch, self._batch = self._batch, []
        self._publish_orders([result.motions[0].stamp_ns for result in batch])
        last = batch[-1]
        frozen = [name for name, held in zip(self._names, last.alarms, strict=True) if held]
        self.statistics.details = {
            'qp_status': last.status.name.lower(),
            'frozen': ', '.join(frozen),
            'tracks_left_out': str(last.tracks_left_out),
            **self._operator.details(),
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

    def _publish_orders(self, stamps_ns: list[int]) -> None:
        """Tell what was asked at each tick, from the first time on that something was."""
        orders, self._orders = self._orders, []
        self._was_asked = self._was_asked or not all(order.is_empty for order in orders)
        if self._was_asked:
            rows = [told(order) for order in orders]
            self._commands.publish(serialize_message(series(self._asked, stamps_ns, rows)))


def main() -> None:
    """Run the node."""
    run_node(CoordinatorNode)
