"""What the driver tells the graph: what is measured at full rate, the rest for people."""

from __future__ import annotations

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState, Joy
from std_msgs.msg import String

from layered_cbf_ros.interfaces import JOINT_NAMES, Measured
from layered_cbf_ros.messages import standard
from layered_cbf_ros.messages.joint_state import JointStateWriter
from layered_cbf_ros.messages.measured import MeasuredWriter
from layered_cbf_ros.messages.robot_state import FOOT_NAMES
from layered_cbf_ros.node_topics import measured as measured_topic
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.transport import latched
from layered_cbf_ros.plants.a1.frames import LowCommand, LowState
from layered_cbf_ros.plants.a1.remote import read_remote
from layered_cbf_ros.scenario_emulation import BUTTONS

PEOPLE_CYCLES = 20
"""People and tools are told at 50 Hz, one thing in a cycle: all at once would make it late."""
SENT_NAMES = (*JOINT_NAMES, *(f'{name}/gains' for name in JOINT_NAMES), 'motors')


class DriverOutputs:
    """Publishes what one robot tells."""

    def __init__(self, node: GraphNode, robot: str, dry_run: bool) -> None:
        self._robot = robot
        self._measured = node.writer(JointState, measured_topic(robot))
        self._encoder = MeasuredWriter(robot)
        kinds = (
            ('joint_states', JointState, self._joint_states),
            ('imu', Imu, self._imu),
            ('foot_contacts', JointState, self._foot_contacts),
            ('temperatures', JointState, self._temperatures),
            ('remote', Joy, self._remote),
        )
        self._people = [(node.writer(kind, topic, 0), make) for topic, kind, make in kinds]
        self._apart = PEOPLE_CYCLES // len(kinds)
        self._state = node.create_publisher(String, 'driver_state', latched())
        self._sent = node.writer(JointState, '~/would_send', 0) if dry_run else None
        self._sent_encoder = JointStateWriter(SENT_NAMES, robot)
        self._sent_values = np.zeros((3, len(SENT_NAMES)))

    def publish_measured(self, stamp_ns: int, state: LowState) -> None:
        """Tell the estimator what the sensors read."""
        joints = np.array([state.position, state.velocity, state.torque])
        measured = Measured(
            stamp_ns,
            joints,
            state.orientation,
            state.angular_velocity,
            state.specific_force,
            state.foot_force,
        )
        self._measured.publish(self._encoder.encode(measured))

    def is_for_people(self, cycle: int) -> bool:
        """Tell whether people are told something in a cycle."""
        return cycle % self._apart == 0

    def publish_for_people(self, cycle: int, stamp_ns: int, state: LowState) -> None:
        """Tell people what is due in a cycle that is for them."""
        writer, make = self._people[cycle % PEOPLE_CYCLES // self._apart]
        writer.publish(serialize_message(make(stamp_ns, state)))

    def publish_sent(self, stamp_ns: int, command: LowCommand) -> None:
        """Tell, in a dry run, what would be sent: gains in position and velocity of `/gains`."""
        if self._sent is None:
            return
        values = self._sent_values
        values[0, :12], values[1, :12], values[2, :12] = (
            command.position,
            command.velocity,
            command.torque,
        )
        values[0, 12:24], values[1, 12:24] = command.kp, command.kd
        values[0, 24] = command.mode
        self._sent.publish(self._sent_encoder.encode(stamp_ns, *values))

    def tell(self, words: str) -> None:
        """Tell what the driver does; late joiners hear it too."""
        self._state.publish(String(data=words))

    @staticmethod
    def _joint_states(stamp_ns: int, state: LowState) -> JointState:
        return standard.named_values(
            stamp_ns, JOINT_NAMES, state.position, state.velocity, state.torque
        )

    def _imu(self, stamp_ns: int, state: LowState) -> Imu:
        return standard.imu(
            self._robot,
            stamp_ns,
            state.orientation,
            state.angular_velocity,
            state.specific_force,
        )

    @staticmethod
    def _foot_contacts(stamp_ns: int, state: LowState) -> JointState:
        """Return what the feet's air bags read, in the sensor's unit."""
        return standard.named_values(stamp_ns, FOOT_NAMES, effort=state.foot_force)

    @staticmethod
    def _temperatures(stamp_ns: int, state: LowState) -> JointState:
        """Return each motor's temperature as position [degC], its mode as velocity."""
        temperature, mode = state.temperature.astype(float), state.mode.astype(float)
        return standard.named_values(stamp_ns, JOINT_NAMES, temperature, mode)

    def _remote(self, stamp_ns: int, state: LowState) -> Joy:
        """Return the robot's own remote control: lx, ly, rx, ry, and its buttons by their bits."""
        remote = read_remote(state.remote)
        return Joy(
            header=standard.header(stamp_ns, self._robot),
            axes=list(remote.sticks),
            buttons=[int(name in remote.buttons) for name in BUTTONS],
        )
