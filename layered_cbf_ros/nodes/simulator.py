"""simulator: PyBullet A1s and scripted obstacles; the source of time in simulation."""

from __future__ import annotations

import os
import time

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from layered_cbf_ros.errors import MissingInputError
from layered_cbf_ros.interfaces import JOINT_NAMES, NS_PER_S, Array
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.joint_state import JointStateReader
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import SLICE_S, GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.simulator_outputs import SimulatorOutputs
from layered_cbf_ros.nodes.transport import Reader, decoded, latched
from layered_cbf_ros.plants.bullet_world import STEP_NS, BulletWorld
from layered_cbf_ros.plants.goals import GoalWatch
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario_file import load_scenario

MANY = 1000  # nodes whose latched word is kept
POLL_NS = 80_000  # only the simulator polls: more pollers would starve each other
RECORDER_WINDOW_NS = 60_000_000  # what every publisher still has, should it be lost on the way
START_LIMIT_NS = 60_000_000_000
LATE_NS = 100_000_000  # beyond this the real-time schedule starts anew


class SimulatorNode(GraphNode):
    """Steps the world with the commands of every robot."""

    def __init__(self) -> None:
        super().__init__('simulator')
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the physics engine talks to itself
        self._scenario = scenario = load_scenario(self.scenario)
        names = [robot.name for robot in scenario.robots]
        model = RobotModel()
        starts = [
            model.nominal_configuration(np.array(robot.position), robot.yaw)
            for robot in scenario.robots
        ]
        self._world = BulletWorld(scenario, declare(self, SimulatorParameters), starts)
        self._state = self.writer(JointState, self.state_topic, 2 * len(names) + 1)
        self._encoder = StateWriter(names)
        self._commands = [
            Input(
                self,
                self.reader(JointState, f'/{name}/joint_commands'),
                self.rules.command,
                JointStateReader(JOINT_NAMES).read,
                f'/{name}/whole_body_controller',
                POLL_NS,
            )
            for name in names
        ]
        self._outputs = SimulatorOutputs(self, scenario, self._world)
        self._goals = GoalWatch(scenario)
        self._progress = Reader(self, Header, '/recorder/progress') if self.recorded else None
        self._recorded_ns = 0
        self._absent = set(self.declare_parameter('wait_for', ['']).value) - {''}
        self._ready_words = Reader(self, String, '/ready', latched(MANY))

    def run(self) -> None:
        """Step the world until every goal is reached or the scenario's time is over."""
        self.become_ready()
        self._wait_for_all()
        end_ns = round(self._scenario.duration * NS_PER_S)
        begin_ns = time.monotonic_ns()
        while self._world.stamp_ns <= end_ns and not self._goals.all_reached:
            self.serve()
            begun_ns = time.perf_counter_ns()
            states = self._world.states()
            self._state.publish(self._encoder.encode(states))
            self._outputs.publish(states)
            self._goals.watch(states)
            used_ns = time.perf_counter_ns() - begun_ns
            torques, silent = self._torques()
            begun_ns = time.perf_counter_ns()
            for _ in range(self.timing.tick_ns // STEP_NS):
                for robot in silent:
                    self._world.damp(robot)
                self._world.step(torques)
            self.statistics.tick(used_ns + time.perf_counter_ns() - begun_ns)
            if self.lockstep:
                self._wait_for_recorder(RECORDER_WINDOW_NS)
            else:
                begin_ns = self._wait_for_deadline(begin_ns)
        self._wait_for_recorder(self.timing.tick_ns)

    def on_silence(self) -> None:
        """Send the last states again: who has them already sends its answers again."""
        self.resend()

    def _torques(self) -> tuple[Array, list[int]]:
        """Return the commanded torques (N, 12) [Nm], and who sent none to act on."""
        stamp_ns = self._world.stamp_ns
        silent = []
        torques = np.zeros((len(self._commands), len(JOINT_NAMES)))
        for i, command in enumerate(self._commands):
            received = command.at(stamp_ns)
            if received is not None:
                torques[i] = received[1][2]
            elif stamp_ns:
                silent.append(i)
        return torques, silent

    def _wait_for_deadline(self, begin_ns: int) -> int:
        """Sleep until the next state is due; return the schedule's (new) begin [ns]."""
        late_ns = time.monotonic_ns() - begin_ns - self._world.stamp_ns
        if late_ns < 0:
            time.sleep(-late_ns * 1e-9)
            return begin_ns
        self.statistics.deadline_misses += 1
        return begin_ns + late_ns if late_ns > LATE_NS else begin_ns

    def _wait_for_recorder(self, window_ns: int) -> None:
        """Let the recorder catch up: what isn't recorded can't be proven.

        Raises:
            MissingInputError: If it stops writing.
        """
        if self._progress is None:
            return
        give_up_ns = self.begin_wait()
        while self._world.stamp_ns - self._recorded_ns > window_ns:
            self.serve()
            data = self._progress.take()
            if data is not None:
                self._recorded_ns = max(self._recorded_ns, stamp_of(data))
            elif time.monotonic_ns() > give_up_ns:
                raise MissingInputError(f'MISSING /recorder: nothing on {self._progress.topic}')
            else:
                self._progress.wait(SLICE_S)

    def _wait_for_all(self) -> None:
        """Wait until every node of the run is ready.

        Raises:
            MissingInputError: If somebody does not become ready in time.
        """
        give_up_ns = time.monotonic_ns() + START_LIMIT_NS
        while self._absent:
            while (data := self._ready_words.take()) is not None:
                word = self.accept(lambda bytes_: decoded(bytes_, String).data, data)
                self._absent.discard(word or '')
            self.statistics.waiting_for = ', '.join(sorted(self._absent))
            self.serve()
            time.sleep(0.2 * SLICE_S)
            if time.monotonic_ns() > give_up_ns:
                raise MissingInputError(f'MISSING {min(self._absent)}: not ready')
        self.statistics.waiting_for = ''


def main() -> None:
    """Run the node."""
    run_node(SimulatorNode)
