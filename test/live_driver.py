"""The driver as a process, a scripted robot at its other end, and what both are heard to do."""

from __future__ import annotations

import functools
import signal
import socket
import time

import numpy as np
from live_node import LiveNode
from scripted_a1 import ScriptedA1
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.messages import standard
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.nodes.transport import latched

# Quick motions, and a slow clock and watchdogs that a loaded machine does not trip.
PACE = 0.5
QUICK = {
    'pace': PACE,
    'address': '127.0.0.1', 'answer_timeout': 1.0,
    'fold_time': 0.2, 'stand_up_time': 0.5, 'damped_time': 1.0,
    'command_timeout': 0.2, 'state_timeout': 0.2,
}  # fmt: skip
CARRYING = np.tile([0.0, 0.0, 5.0], 4)


def free_port() -> int:
    """Return a UDP port of this computer that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('', 0))
        return probe.getsockname()[1]


class LiveDriver(LiveNode):
    """The process, the robot, and what was heard of both.

    Attributes:
        states: Each thing that the driver said it does.
        stamps: Of measured states [ns].
        heard: The last message of each topic for people.
    """

    def __init__(self, *options: str, **parameters: object) -> None:
        self.robot, self.port = ScriptedA1(), free_port()
        values = QUICK | {'port': self.robot.port, 'local_port': self.port} | parameters
        arguments = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
        super().__init__('a1_driver', '-r', '__ns:=/a1_0', *arguments, '--', *options)
        self.states: list[str] = []
        self.stamps: list[int] = []
        self.heard: dict[str, object] = {}
        node = self.node
        node.create_subscription(String, '/a1_0/driver_state', self._note_state, latched())
        node.create_subscription(JointState, '/a1_0/measured', self._note_stamp, 10, raw=True)
        self._commanded_at = 0.0
        for topic, kind in (('joint_states', JointState), ('remote', Joy)):
            note = functools.partial(self.heard.__setitem__, topic)
            node.create_subscription(kind, f'/a1_0/{topic}', note, 10)
        self.commands = node.create_publisher(JointState, '/a1_0/joint_commands', 10)
        self.e_stop = node.create_publisher(Bool, '/e_stop', 10)

    def _note_state(self, message: String) -> None:
        self.states.append(message.data)

    def _note_stamp(self, data: bytes) -> None:
        self.stamps.append(stamp_of(data))
        self.measured = data

    def until_state(self, words: str, act=None) -> None:
        """Wait until the driver says that it does something."""
        self.until(lambda: bool(self.states) and words in self.states[-1], act)

    def call(self, order: str) -> Trigger.Response:
        """Call one of its services."""
        client = self.node.create_client(Trigger, f'/a1_0/a1_driver/{order}')
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def control(self) -> None:
        """Command torques each 10 ms, stamped with the newest state, as a controller does."""
        if self.stamps and time.monotonic() - self._commanded_at > 0.01:
            self._commanded_at = time.monotonic()
            message = standard.named_values(self.stamps[-1], JOINT_NAMES, effort=CARRYING)
            self.commands.publish(message)

    def end(self, number: signal.Signals) -> int:
        """End the process by a signal; return its exit code, the robot still listening."""
        self.process.send_signal(number)
        code = self.process.wait(20.0)
        time.sleep(0.05)  # the robot looks for packets each millisecond
        return code

    def close(self) -> None:
        """Let everything go."""
        if self.process.poll() is None:
            self.process.kill()
        self.stop()
        self.robot.end()
