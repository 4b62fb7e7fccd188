"""The calling side of `supervisor arm`, `sit_down` and `reset`."""

from __future__ import annotations

import os
import sys
import time

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from layered_cbf_ros.nodes.transport import find_each_other_fast
from layered_cbf_ros.supervision.order_command import Order

EXIT_REFUSED = 1
SLICE_S = 0.1


def give_order(order: Order) -> int:
    """Call the drivers one after the other, print what each answers; return the exit code.

    The first that does not obey is the last that is asked.
    """
    find_each_other_fast()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f'supervisor_{order.word}_{os.getpid()}', enable_rosout=False)
    try:
        for robot in order.robots:
            answer = ask(node, order.service(robot), order.timeout)
            if answer is None:
                domain = os.environ.get('ROS_DOMAIN_ID') or '0'
                print(
                    f'ERROR {robot}: nobody answers at {order.service(robot)}; '
                    f'is its driver running, on ROS_DOMAIN_ID {domain}?',
                    file=sys.stderr,
                )
                return EXIT_REFUSED
            if not answer.success:
                print(f'ERROR {robot}: {answer.message}', file=sys.stderr)
                return EXIT_REFUSED
            print(f'{robot}: {answer.message}')
    except KeyboardInterrupt:
        return EXIT_REFUSED
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def ask(node: Node, service: str, timeout: float) -> Trigger.Response | None:
    """Return the answer of a service, None if there is none in time [s]."""
    client, end = node.create_client(Trigger, service), time.monotonic() + timeout
    if not client.wait_for_service(timeout_sec=timeout):
        return None
    future = client.call_async(Trigger.Request())
    while not future.done() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=SLICE_S)
    return future.result() if future.done() else None
