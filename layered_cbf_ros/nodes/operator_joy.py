"""The page's virtual pad on the graph: its Joy messages, and its calls to the simulator."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Joy
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from layered_cbf_ros.node_topics import JOY, PAUSE, STEP
from layered_cbf_ros.operation.virtual_pad import FRAME, PadState

ANSWER_S = 2.0
NOBODY = 'the simulator does not answer'
DEPTH = 10


class OperatorJoy(Node):
    """A node beside the viewer's: it works while that one draws, from any thread."""

    def __init__(self, robots: Callable[[], Sequence[str]]) -> None:
        """Join the graph.

        Args:
            robots: Returns the names of the robots, as far as they are known.
        """
        super().__init__('viewer_operator', start_parameter_services=False)
        self._robots = robots
        self._joy = self.create_publisher(Joy, JOY, DEPTH)
        self._pause = self.create_client(SetBool, PAUSE)
        self._step = self.create_client(Trigger, STEP)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        self._calling = threading.Lock()

    def operate(self, pad: PadState) -> None:
        """Send what is held on the virtual pad."""
        stamp = self.get_clock().now().to_msg()
        header = Header(stamp=stamp, frame_id=f'{FRAME}/viewer')
        buttons = pad.buttons(len(self._robots()))
        self._joy.publish(Joy(header=header, axes=pad.axes(), buttons=buttons))

    def pause(self, paused: bool) -> str:
        """Hold the simulated time, or let it go on; return what the simulator said."""
        return self._call(self._pause, SetBool.Request(data=paused))

    def step(self) -> str:
        """Let the held time go on by one period of plans; return what the simulator said."""
        return self._call(self._step, Trigger.Request())

    def _call(self, client: Client, request: Any) -> str:
        """Call a service, one caller at a time, and wait for its answer a while."""
        with self._calling:
            if not client.wait_for_service(ANSWER_S):
                return NOBODY
            future = client.call_async(request)
            self._executor.spin_until_future_complete(future, ANSWER_S)
            if not future.done():
                client.remove_pending_request(future)
                return NOBODY
            return str(future.result().message)
