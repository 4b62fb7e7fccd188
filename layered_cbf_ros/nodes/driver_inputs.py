"""What the driver hears from the graph: joint commands, the emergency stop."""

from __future__ import annotations

from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import JOINT_NAMES, NS_PER_S
from layered_cbf_ros.messages.joint_state import JointStateReader
from layered_cbf_ros.node_topics import E_STOP
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.transport import Reader, decoded
from layered_cbf_ros.plants.a1.driver_memory import JointCommand


class DriverInputs:
    """Takes messages by hand, each cycle, without a wait.

    Attributes:
        command: The newest good joint command, None before the first.
    """

    def __init__(self, node: GraphNode) -> None:
        self._node = node
        self._commands = node.reader(JointState, 'joint_commands')
        self._stop = Reader(node, Bool, E_STOP)
        self._decoder = JointStateReader(JOINT_NAMES)
        self.command: JointCommand | None = None

    def take_command(self, now_ns: int) -> str:
        """Take what has come; return why a command was refused, '' if none was.

        Args:
            now_ns: Time of this cycle [ns].
        """
        newest = None
        while (data := self._commands.take()) is not None:
            newest = data
        if newest is None:
            return ''
        try:
            self._keep(newest, now_ns)
        except MessageError as error:
            self._node.statistics.reject(f'{self._commands.topic}: {error}')
            return str(error)
        return ''

    def take_emergency_stop(self) -> bool:
        """Tell whether an emergency stop was asked for since the last cycle."""
        stopped = False
        while (data := self._stop.take()) is not None:
            stopped |= bool(self._node.accept(lambda raw: decoded(raw, Bool).data, data, E_STOP))
        return stopped

    def _keep(self, data: bytes, now_ns: int) -> None:
        """Keep a command if it is newer than the last.

        Raises:
            MessageError: If it is malformed, not finite, or from another time.
        """
        stamp_ns, values = self._decoder.read(data)
        if stamp_ns > now_ns:
            ahead = (stamp_ns - now_ns) / NS_PER_S
            raise MessageError(f'stamp {stamp_ns / NS_PER_S:.3f} s is {ahead:.3f} s in the future')
        if self.command is None or stamp_ns > self.command.stamp_ns:
            self.command = JointCommand(stamp_ns, *values)
