"""viewer: the run as a page in the browser, live or from a bag; live it may be steered too."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from layered_cbf_ros.bags.command_line import run_verb
from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.nodes.operator_joy import OperatorJoy
from layered_cbf_ros.nodes.ros_tools import RosTools
from layered_cbf_ros.nodes.sight_subscriptions import SightSubscriptions
from layered_cbf_ros.nodes.transport import find_each_other_fast, latched
from layered_cbf_ros.viewing.scene.pace import Pace
from layered_cbf_ros.viewing.sight.live import LiveSight
from layered_cbf_ros.viewing.sight.snapshot import Snapshot
from layered_cbf_ros.viewing.viewer_options import ViewerOptions, parse_viewer

if TYPE_CHECKING:
    import viser

    from layered_cbf_ros.viewing.front.front import Front

ROS_ARGUMENTS = '--ros-args'
EXIT_BROKEN = 1
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
NICENESS = 5
"""Control goes first: a picture may come late. Beyond that the stick would be late too."""


class Ending:
    """Whether somebody has asked the viewer to end."""

    def __init__(self) -> None:
        self.is_asked = False
        for number in ENDINGS:
            signal.signal(number, self._ask)

    def __call__(self) -> bool:
        """Return whether it is to end."""
        return self.is_asked

    def _ask(self, number: int, frame: object) -> None:
        self.is_asked = True


class LiveShow:
    """The running graph in the page."""

    def __init__(self, server: viser.ViserServer, options: ViewerOptions) -> None:
        from layered_cbf_ros.viewing.scene.view import TimeButtons, View

        self._node = Node('viewer', start_parameter_services=False)
        self._ready = self._node.create_publisher(String, '/ready', latched())
        self._sight = LiveSight()
        self._subscriptions = SightSubscriptions(self._node, self._sight)
        self.team = OperatorJoy(self._robots)
        self._tools = RosTools(self._node) if options.markers else None
        self._view = View(server, TimeButtons(self.team.pause, self.team.step))
        self._opened = 0
        self.snapshot: Snapshot | None = None

    def run(self, front: Front, is_stopped: Ending) -> None:
        """Show the graph until told to stop, or until the front breaks."""
        pace = Pace()
        while front.is_open and not is_stopped():
            pace.wait()
            self.draw(front.is_watched)

    def draw(self, has_pages: bool) -> None:
        """Show what is new.

        Args:
            has_pages: Whether a page is open; its figures are wanted even without the scene.
        """
        is_watched = has_pages or self._view.is_watched or self._tools is not None
        self._subscriptions.take(is_watched, self._view.wants_forces)
        scenario = self._sight.scenario
        if scenario is None:
            return
        if self._opened != self._sight.runs:
            self._opened = self._sight.runs
            self._view.open(scenario)
        self.snapshot = self._sight.snapshot(time.monotonic())
        if self._sight.has_state:
            self._view.show(self.snapshot)
            if self._tools is not None:
                self._tools.publish(self.snapshot)

    def tell_ready(self) -> None:
        """Tell a supervisor that the page is open."""
        self._ready.publish(String(data=self._node.get_fully_qualified_name()))

    def _robots(self) -> Sequence[str]:
        scenario = self._sight.scenario
        return [] if scenario is None else [robot.name for robot in scenario.robots]


def view(arguments: Sequence[str]) -> int:
    """Open the page and serve it until asked to end; return the exit code."""
    own = list(arguments)
    ros = own[own.index(ROS_ARGUMENTS) :] if ROS_ARGUMENTS in own else []
    options = parse_viewer(own[: len(own) - len(ros)])
    try:
        from layered_cbf_ros.viewing.scene.viser_server import start_viser, stop_viser
    except ImportError as error:
        raise LayeredCbfError(
            f'the viewer needs the package {error.name}; pip install viser aiohttp'
        ) from None
    ending = Ending()
    server, code = start_viser(), 0
    try:
        if options.run is not None:
            _show_bag(server, options, ending)
        else:
            os.nice(NICENESS)
            find_each_other_fast()
            rclpy.init(args=ros, signal_handler_options=SignalHandlerOptions.NO)
            code = _show_graph(server, options, ending)
            rclpy.shutdown()
    finally:
        stop_viser(server)
    return code


def _show_bag(server: viser.ViserServer, options: ViewerOptions, ending: Ending) -> None:
    from layered_cbf_ros.viewing.front.front import Front
    from layered_cbf_ros.viewing.scene.bag_show import BagShow
    from layered_cbf_ros.viewing.sight.bag_sight import BagSight

    assert options.run is not None
    show = BagShow(server, BagSight(options.run))
    front = Front(options.front, server.get_port(), lambda: show.snapshot, None)
    print(f'viewer: {front.address}', flush=True)
    show.run(ending)
    front.close()


def _show_graph(server: viser.ViserServer, options: ViewerOptions, ending: Ending) -> int:
    """Show the graph; return the exit code, 1 if the front broke."""
    from layered_cbf_ros.viewing.front.front import Front

    show = LiveShow(server, options)
    front = Front(options.front, server.get_port(), lambda: show.snapshot, show.team)
    print(f'viewer: {front.address}', flush=True)
    show.tell_ready()
    show.run(front, ending)
    code = 0 if front.is_open else EXIT_BROKEN
    front.close()
    return code


def main() -> None:
    """Run the viewer."""
    run_verb(view)
