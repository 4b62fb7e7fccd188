"""state_estimator: where one robot is and how it moves, from its sensors; feeds its layers."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.interfaces import NS_PER_S, RobotState
from layered_cbf_ros.messages.external_pose import ExternalPoseReader
from layered_cbf_ros.messages.ground_forces import GroundForceReader
from layered_cbf_ros.messages.measured import MeasuredReader
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.messages.standard import odometry
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.transport import Reader
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.external_pose import ExternalPose
from layered_cbf_ros.perception.state_estimator import Estimate, EstimatorMemory, StateEstimator
from layered_cbf_ros.timing import StampGuard

HEARERS = 3  # of a robot's state: the coordinator, and its two controllers
PEOPLE_NS = NS_PER_S // 50
LONGEST_LAG_NS = NS_PER_S // 5


class StateEstimatorNode(GraphNode):
    """Wires sensors, the gait and motion capture to the estimator, and states to the layers."""

    def __init__(self) -> None:
        super().__init__('state_estimator')
        self._robot = robot = self.get_namespace().strip('/')
        parameters = declare(self, StateEstimatorParameters)
        if self.lockstep and not parameters.standing_at_start:
            raise ParameterError(
                'state_estimator: standing_at_start is false; in lockstep set it to true: '
                'every node waits for states from the first tick on'
            )
        self._estimator = StateEstimator(parameters)
        self._measured, self._decoder = self.reader(JointState, 'measured'), MeasuredReader()
        self._plan = Input(
            self,
            self.reader(JointState, 'ground_forces'),
            self.rules.forces,
            GroundForceReader().read,
            f'/{robot}/ground_force_mpc',
        )
        self._states, self._encoder = (
            self.writer(JointState, 'state', HEARERS),
            StateWriter([robot]),
        )
        self._odometry = self.writer(Odometry, 'odom', 0)
        # Motion capture sends when it likes: in lockstep no run would repeat.
        heard = parameters.external_pose and not self.lockstep
        self._outside = Reader(self, PoseStamped, 'external_pose') if heard else None
        self._pose = ExternalPoseReader(parameters.external_frame)
        self._early: list[ExternalPose] = []
        self._next: bytes | None = None
        self._told_ns = -PEOPLE_NS

    def run(self) -> None:
        """Estimate on every measurement."""
        self.become_ready()
        memory: EstimatorMemory | None = None
        every_ns = self.timing.tick_ns
        received = self.each(self._measured, every_ns) if self.lockstep else self._as_they_come()
        for data in received:
            measured = self.accept(self._decoder.read, data, self._measured.topic)
            if measured is None:
                continue
            walks = self.lockstep or (memory is not None and memory.belief is not None)
            plan = self._plan.at(measured.stamp_ns) if walks else None
            poses = self._poses(measured.stamp_ns)
            begun_ns = time.perf_counter_ns()
            estimate = self._estimator.step(memory, measured, plan, poses)
            memory = estimate.memory
            self._publish(estimate)
            self.statistics.tick(time.perf_counter_ns() - begun_ns)

    def _as_they_come(self) -> Iterator[bytes]:
        """Yield every measurement, in order: each one moves the estimate on."""
        guard, last_ns, tick_ns = StampGuard(), -1, self.timing.tick_ns
        self.statistics.period_ns = round(tick_ns / self.timing.pace)
        while True:
            self.serve()
            data = self._next or self._measured.take()
            if data is None:
                self.wait(self._measured, None, '')
                continue
            self._next = self._measured.take()
            stamp_ns = self.accept(guard.check, data, self._measured.topic)
            if stamp_ns is None or stamp_ns == last_ns:
                continue
            if last_ns >= 0:
                self.statistics.deadline_misses += max(0, round((stamp_ns - last_ns) / tick_ns) - 1)
            last_ns = stamp_ns
            self.statistics.begin(time.monotonic_ns(), stamp_ns)
            yield data

    def _poses(self, now_ns: int) -> list[ExternalPose]:
        """Return the sound poses that motion capture has sent up to now.

        Who is behind with measurements keeps those that are still to come.
        """
        if self._outside is None:
            return []
        while (data := self._outside.take()) is not None:
            pose = self.accept(self._pose.read, data, self._outside.topic)
            self._early += [pose] if pose is not None else []
        due = [p for p in self._early if not 0 < p.stamp_ns - now_ns < LONGEST_LAG_NS]
        self._early = [p for p in self._early if 0 < p.stamp_ns - now_ns < LONGEST_LAG_NS]
        return due

    def _publish(self, estimate: Estimate) -> None:
        """Send the state, if there is one; tell people now and then."""
        for why in estimate.refused:
            self.statistics.reject(why)
        state = estimate.state
        if state is not None and self._next is None:  # else it is old before it arrives
            self._states.publish(self._encoder.encode([state]))
        stamp_ns = estimate.memory.stamp_ns
        if stamp_ns - self._told_ns >= PEOPLE_NS:
            self._told_ns = stamp_ns - stamp_ns % PEOPLE_NS
            self._tell(estimate, state)

    def _tell(self, estimate: Estimate, state: RobotState | None) -> None:
        """Publish odometry for people, and how the estimate comes about."""
        self.statistics.details = {
            'waits_for': estimate.memory.waits_for,
            'trust': ' '.join(f'{trust:.1f}' for trust in estimate.trust),
            'outliers': str(estimate.memory.poses.outliers),
        }
        belief, poses = estimate.memory.belief, estimate.memory.poses
        if state is None or belief is None:
            return
        message = odometry(self._robot, state)
        pose, twist = self._estimator.variances(belief, poses.yaw_variance)
        message.pose.covariance, message.twist.covariance = (
            np.diag(pose).ravel(),
            np.diag(twist).ravel(),
        )
        self._odometry.publish(serialize_message(message))


def main() -> None:
    """Run the node."""
    run_node(StateEstimatorNode)
