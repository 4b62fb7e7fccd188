"""A real node process, and a ROS node in the test that talks to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from layered_cbf_ros.nodes.transport import PROFILES
from layered_cbf_ros.resources import find_folder

# Domains up to 101 are safe on every system; by process, so that runs don't meet.
DOMAIN = 20 + os.getpid() % 60
ENVIRONMENT = os.environ | {
    'ROS_DOMAIN_ID': str(DOMAIN),
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    'OMP_NUM_THREADS': '1',
    # As the supervisor gives to every node: who is there is found out in a moment.
    PROFILES: str(find_folder('params') / 'fast_dds.xml'),
}
LIMIT_S = 30.0


class LiveNode:
    """Starts an executable as a process; its diagnostics are kept, newest first to ask."""

    def __init__(self, executable: str, *ros_arguments: str, before: str = '') -> None:
        os.environ.update(ENVIRONMENT)
        code = f'{before}\nfrom layered_cbf_ros.nodes.{executable} import main; main()'
        self.process = subprocess.Popen(
            [sys.executable, '-c', code, '--ros-args', *ros_arguments],
            env=ENVIRONMENT,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self.node = Node('test', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.figures: dict[str, str] = {}
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._note, 10)

    def _note(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.figures = {entry.key: entry.value for entry in status.values}

    def until(self, condition: Callable[[], bool], act: Callable[[], None] | None = None) -> None:
        """Serve (and act, every 10 ms) until a condition holds; fail after a while."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert self.process.poll() is None, self.process.stderr.read()
            assert time.monotonic() < end, f'never came true; figures are {self.figures}'
            if act is not None:
                act()
            self._executor.spin_once(timeout_sec=0.01)

    def until_matched(self, *publishers) -> None:
        """Wait until the process has subscribed to all of these."""
        self.until(lambda: all(p.get_subscription_count() for p in publishers))

    def stop(self) -> int:
        """End the process as Ctrl-C would; return its exit code."""
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(10.0)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
        self.process.stderr.close()
        return code
