"""The simulated bases with their topics: odometry out, safe velocities in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry

from layered_cbf_ros.discs import disc_offsets, disc_radii, shared_frame
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.odometry import OdometryWriter
from layered_cbf_ros.messages.twist import read_twist
from layered_cbf_ros.node_topics import cmd_vel_safe, odometry
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.simulator_outputs import SimulatorOutputs
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.plants.planar_world import STEP_NS, PlanarWorld
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import InputRule


class FleetPlant:
    """Steps the bases of a scenario; one that hears nothing for a while stops by itself."""

    def __init__(self, node: GraphNode, scenario: Scenario) -> None:
        names = [robot.name for robot in scenario.robots]
        parameters = declare(node, SimulatorParameters)
        radii, offsets = disc_radii(scenario), disc_offsets(scenario)
        self._world = PlanarWorld(
            scenario, parameters, [radii[name] for name in names], [offsets[name] for name in names]
        )
        tick_ns = node.timing.tick_ns
        self._steps = tick_ns // STEP_NS
        self._odometry = [node.writer(Odometry, odometry(name)) for name in names]
        self._encoders = [OdometryWriter(name, shared_frame(scenario)) for name in names]
        rule = InputRule(tick_ns, tick_ns, round(parameters.base_timeout * NS_PER_S))
        self._inputs = [
            Input(
                node,
                node.reader(TwistStamped, cmd_vel_safe(name)),
                rule,
                read_twist,
                '/coordinator',
            )
            for name in names
        ]
        self._commands = np.zeros((len(names), 3))
        self._outputs = SimulatorOutputs(node, scenario, self._world)

    @property
    def stamp_ns(self) -> int:
        """Time of the present state [ns]."""
        return self._world.stamp_ns

    def publish(self) -> Sequence[Array]:
        """Publish what is due now; return the centre of each disc [m], (2,)."""
        for writer, encoder, state in zip(
            self._odometry, self._encoders, self._world.states(), strict=True
        ):
            writer.publish(encoder.encode(state))
        self._outputs.publish(self.stamp_ns)
        return list(self._world.discs)

    def hear(self) -> None:
        """Take the velocities; who is told nothing is told to stop."""
        for i, command in enumerate(self._inputs):
            received = command.at(self.stamp_ns)
            self._commands[i] = 0.0 if received is None else received[1]

    def advance(self) -> None:
        """Go on by one tick."""
        for _ in range(self._steps):
            self._world.step(self._commands)
