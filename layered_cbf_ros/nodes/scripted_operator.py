"""The simulated person of a scenario: sends a pad's Joy messages in the run's own time."""

from __future__ import annotations

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Joy

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.standard import header
from layered_cbf_ros.node_topics import JOY
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.operation.virtual_pad import PadState
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_operator import SOURCE, PadStep, held_at
from layered_cbf_ros.timing import SCRIPT_NS


class ScriptedOperator:
    """Holds the pad as the scenario says."""

    def __init__(self, node: GraphNode, scenario: Scenario) -> None:
        self._script = scenario.operator
        self._robots = [robot.name for robot in scenario.robots]
        self._writer = node.writer(Joy, JOY)

    def publish(self, stamp_ns: int) -> None:
        """Send what is held at a stamp, when a message is due."""
        if stamp_ns % SCRIPT_NS == 0:
            pad = self._pad(held_at(self._script, stamp_ns / NS_PER_S))
            message = Joy(header=header(stamp_ns, SOURCE))
            message.axes, message.buttons = pad.axes(), pad.buttons(len(self._robots))
            self._writer.publish(serialize_message(message))

    def _pad(self, step: PadStep) -> PadState:
        return PadState(
            x=step.x,
            y=step.y,
            yaw=step.yaw,
            enable=step.enable,
            turbo=step.turbo,
            e_stop=step.e_stop,
            reset=step.reset,
            select_all=step.steer == 'all',
            formation=step.steer == 'formation',
            release=step.steer == 'nobody',
            robot=self._robots.index(step.steer) if step.steer in self._robots else None,
        )
