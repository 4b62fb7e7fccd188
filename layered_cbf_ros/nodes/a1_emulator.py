"""a1_emulator: emulated A1s in one world, each at the other end of a wire; no robot is needed."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from layered_cbf_ros.errors import ScenarioError
from layered_cbf_ros.interfaces import NS_PER_S, Array, RobotState
from layered_cbf_ros.messages import standard
from layered_cbf_ros.messages.robot_state import StateWriter
from layered_cbf_ros.node_topics import STATE
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.scenario_node import ScenarioNode
from layered_cbf_ros.nodes.simulator_outputs import SimulatorOutputs, latch
from layered_cbf_ros.plants.a1.peer import Peer
from layered_cbf_ros.plants.bullet_world import STEP_NS, BulletWorld
from layered_cbf_ros.plants.emulation.emulated_a1 import EmulatedA1
from layered_cbf_ros.plants.emulation.lying import lying_configuration, placed
from layered_cbf_ros.plants.emulation.parameters import EmulatorParameters
from layered_cbf_ros.plants.goals import GoalWatch
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_description import robot_description
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.run_clock import RunClock
from layered_cbf_ros.run_nodes import FINISHED
from layered_cbf_ros.scenario import EMULATED_A1, Scenario

PEOPLE_NS = NS_PER_S // 50
LATE_NS = 20_000_000  # so far behind the clock, steps count as missed
BEGIN_S = 0.02


class A1EmulatorNode(ScenarioNode):
    """Steps the world by the run's clock, whoever commands its robots."""

    def __init__(self) -> None:
        super().__init__('a1_emulator')
        scenario = self._scenario
        if scenario.plant != EMULATED_A1:
            raise ScenarioError(
                f'{scenario.name}: plant is {scenario.plant}; for the emulator say {EMULATED_A1}'
            )
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the physics engine talks to itself
        parameters = declare(self, EmulatorParameters)
        emulation, limit = scenario.emulation, parameters.torque_limit
        self._names = [robot.name for robot in scenario.robots]
        self._world = BulletWorld(
            scenario,
            SimulatorParameters(torque_limit=limit, exact_within=parameters.exact_within),
            start_configurations(scenario),
        )
        self._robots = [
            EmulatedA1(name, emulation, limit, scenario.seed + 1 + k)
            for k, name in enumerate(self._names)
        ]
        self._peers = [Peer(emulation.address, emulation.port + k) for k in range(len(self._names))]
        self._run_clock = RunClock(self.timing)
        self._goals = GoalWatch(scenario)
        self._outputs = SimulatorOutputs(self, scenario, self._world)
        self._state, self._encoder = self.writer(JointState, STATE, 0), StateWriter(self._names)
        self._truth = [self.writer(Odometry, f'/{name}/truth/odom', 0) for name in self._names]
        urdf = robot_description()
        self._latched = [latch(self, f'/{name}/robot_description', urdf) for name in self._names]

    def run(self) -> None:
        """Step the world as the clock goes; when the scenario is over, tell so.

        It goes on unobserved until asked to end, so that no driver loses its robot.
        """
        self.lockstep, self.statistics.real_time = False, True
        while self._run_clock.now_ns() < 0:
            self.serve()
            time.sleep(BEGIN_S)
        self.tell_ready()
        self.statistics.period_ns = round(STEP_NS / self.timing.pace)
        while True:
            self.serve()
            stamp_ns = self._world.stamp_ns
            self._run_clock.sleep_until(stamp_ns)
            begun_ns = time.monotonic_ns()
            self.statistics.deadline_misses += self._run_clock.now_ns() - stamp_ns > LATE_NS
            self.statistics.begin(begun_ns, stamp_ns)
            if self._is_over(stamp_ns):
                if self.statistics.state != FINISHED:
                    self.publish_diagnostics(FINISHED)
            else:
                self._tell(stamp_ns)
            self._step(stamp_ns)
            self.statistics.tick(time.monotonic_ns() - begun_ns)

    def close(self) -> None:
        """Let the ports go, too."""
        for peer in self._peers:
            peer.close()
        super().close()

    def _is_over(self, stamp_ns: int) -> bool:
        over = stamp_ns > round(self._scenario.duration * NS_PER_S)
        return over or self._goals.all_reached

    def _tell(self, stamp_ns: int) -> None:
        """Publish what is due of the true world."""
        states = self._world.states()
        if stamp_ns % self.timing.tick_ns == 0:
            self._state.publish(self._encoder.encode(states))
        self._outputs.publish(stamp_ns)
        if stamp_ns % PEOPLE_NS == 0:
            self._tell_people(states)
        self._goals.watch(stamp_ns, [state.configuration[:2] for state in states])

    def _step(self, stamp_ns: int) -> None:
        """Answer and hear the drivers, and go on by one step."""
        states = self._world.states()
        torques = np.empty((len(states), 12))
        for k, (robot, peer, state) in enumerate(
            zip(self._robots, self._peers, states, strict=True)
        ):
            for packet, driver in robot.answers(state, self._world.imu(k)):
                peer.send(packet, driver)
            robot.hear(stamp_ns, peer.receive())
            torques[k] = robot.torques(state, STEP_NS / NS_PER_S)
        self._world.step(torques)

    def _tell_people(self, states: Sequence[RobotState]) -> None:
        for name, writer, state, robot in zip(
            self._names, self._truth, states, self._robots, strict=True
        ):
            writer.publish(serialize_message(standard.odometry(name, state)))
            refused = ', '.join(f'{kind} {count}' for kind, count in robot.refused.items())
            self.statistics.details |= {
                f'{name}/refused': refused,
                f'{name}/command_timeouts': str(robot.timeouts),
                f'{name}/hottest_degc': f'{robot.hottest:.0f}',
            }


def start_configurations(scenario: Scenario) -> list[Array]:
    """Return where each robot is at first: on its belly, or standing as the layers have it."""
    if scenario.emulation.lying:
        lying = lying_configuration()
        return [placed(lying, robot.position, robot.yaw) for robot in scenario.robots]
    model = RobotModel()
    return [
        model.nominal_configuration(np.array(robot.position), robot.yaw)
        for robot in scenario.robots
    ]


def main() -> None:
    """Run the node."""
    run_node(A1EmulatorNode)
