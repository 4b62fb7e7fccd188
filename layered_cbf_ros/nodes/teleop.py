"""teleop: a person at a terminal or a gamepad steers, sees and stops the team."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Joy

from layered_cbf_ros.bags.command_line import run_verb
from layered_cbf_ros.bags.playback.terminal import is_controllable
from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.standard import header
from layered_cbf_ros.node_topics import JOY
from layered_cbf_ros.nodes.teleop_news import TeleopNews
from layered_cbf_ros.nodes.transport import find_each_other_fast, reliable
from layered_cbf_ros.operation import virtual_pad
from layered_cbf_ros.operation.gamepad import Gamepad
from layered_cbf_ros.operation.keyboard import KeyBytes, find_keys
from layered_cbf_ros.operation.terminal import Terminal
from layered_cbf_ros.operation.terminal_options import Options, parse, places_of
from layered_cbf_ros.operation.terminal_pad import HeldKeys, of_team
from layered_cbf_ros.operation.terminal_screen import lines_of
from layered_cbf_ros.operation.terminal_view import view_of
from layered_cbf_ros.operation.virtual_pad import PadState

ROS_ARGUMENTS = '--ros-args'
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
FAREWELL = 5  # messages that say that all is let go
PAINT_NS = NS_PER_S // 10
REPEAT_NS = NS_PER_S // 20  # of a gamepad that doesn't move, as joy_node's autorepeat
LATE_NS = NS_PER_S // 4  # keys that waited so long were not meant for now
SLICE_S = 0.01
RELEASED = PadState()


class Teleop:
    """One operator's session."""

    def __init__(self, node: Node, options: Options, terminal: Terminal | None) -> None:
        self._options, self._terminal = options, terminal
        self._name = f'{virtual_pad.FRAME}/teleop/{os.getpid()}'
        self._publisher = node.create_publisher(Joy, JOY, reliable(10))
        self._news = TeleopNews(node)
        self._domain = os.environ.get('ROS_DOMAIN_ID', '0')
        self._gamepad = Gamepad(options.gamepad) if options.has_gamepad else None
        self._bytes, self._keys = KeyBytes(), HeldKeys()
        self._places: tuple[int, ...] = ()
        self._note = ''
        self._farewell = 0
        self._next_send_ns = self._next_repeat_ns = self._next_paint_ns = 0
        self._looked_ns = time.monotonic_ns()
        self.stopped = self._suspended = False
        for number in ENDINGS:
            signal.signal(number, self._stop)
        signal.signal(signal.SIGTSTP, self._suspend)

    def run(self) -> None:
        """Obey keys and pad until asked to end; then let go of everything."""
        try:
            while not self.stopped:
                self._obey_keys()
                self._obey_gamepad()
                self._listen_and_paint()
                if self._suspended:
                    self._stand_aside()
        finally:
            self._let_go()

    def _obey_keys(self) -> None:
        """Wait a moment for keys, and send what is held when it is time to."""
        if self._terminal is None:
            time.sleep(SLICE_S)
            return
        until_due_s = (self._next_send_ns - time.monotonic_ns()) / NS_PER_S
        data = self._terminal.read(min(max(until_due_s, 0.0), SLICE_S))
        now_ns = time.monotonic_ns()
        if data is None:
            self.stopped = True
            return
        is_late, self._looked_ns = now_ns - self._looked_ns > LATE_NS, now_ns
        self._bytes, keys = find_keys(self._bytes, data, now_ns)
        for key in keys:
            after = self._keys.after(key, now_ns, len(self._places))
            if not is_late or after.pad(now_ns).e_stop:
                self._keys = after
        if keys or now_ns >= self._next_send_ns:
            self._next_send_ns = now_ns + round(NS_PER_S / self._options.rate)
            self._send(of_team(self._keys.pad(now_ns), self._places))

    def _send(self, pad: PadState) -> None:
        """Send what is held, and a few times that nothing is; then be silent."""
        self._farewell = self._farewell - 1 if pad == RELEASED else FAREWELL
        if self._farewell >= 0:
            buttons = pad.buttons(len(self._news.heard.robots))
            self._publish(self._name, pad.axes(), buttons, pad.e_stop)
        self._farewell = max(self._farewell, 0)

    def _publish(
        self, name: str, axes: Sequence[float], buttons: Sequence[int], however_late: bool = False
    ) -> None:
        """Send a Joy message; one without a stamp counts however late it comes."""
        message = Joy(header=header(0 if however_late else time.time_ns(), name))
        message.axes, message.buttons = list(axes), list(buttons)
        self._publisher.publish(message)

    def _obey_gamepad(self) -> None:
        """Send what is held on the gamepad when it changes, and again and again."""
        pad = self._gamepad
        if pad is None:
            return
        now_ns, before = time.monotonic_ns(), pad.sticks
        news = pad.poll(now_ns)
        if news:
            self._say(news)
        changed = pad.sticks != before
        if pad.sticks.axes and (changed or now_ns >= self._next_repeat_ns):
            self._next_repeat_ns = now_ns + REPEAT_NS
            self._publish(pad.frame_id, pad.sticks.axes, pad.sticks.buttons)

    def _listen_and_paint(self) -> None:
        now_ns = time.monotonic_ns()
        if now_ns < self._next_paint_ns:
            return
        self._next_paint_ns = now_ns + PAINT_NS
        heard = self._news.listen(now_ns)
        if heard.robots:
            self._places = places_of(self._options.robots, heard.robots)
        if self._terminal is None:
            return
        pad, shown = self._gamepad, [heard.robots[place] for place in self._places]
        view = replace(
            view_of(heard, shown, self._domain, now_ns),
            keys=self._keys,
            pad=self._keys.pad(now_ns),
            own_name=self._name,
            note=self._note if pad is None or pad.path is None else pad.described(),
        )
        size = self._terminal.size
        self._terminal.paint(lines_of(view, size.columns, size.lines))

    def _say(self, line: str) -> None:
        """Say something on the screen, or on a line of its own where there is none."""
        self._note = line
        if self._terminal is None:
            print(line, flush=True)

    def _let_go(self) -> None:
        """Say a few times that nothing is held any more, on the keyboard and on the pad."""
        held = [(self._name, RELEASED.axes(), RELEASED.buttons(0))]
        pad = self._gamepad
        if pad is not None and pad.sticks.axes:
            axes, buttons = pad.sticks.axes, pad.sticks.buttons
            held.append((pad.frame_id, [0.0] * len(axes), [0] * len(buttons)))
            pad.close()
        for _ in range(FAREWELL):
            for each in held:
                self._publish(*each)
            time.sleep(SLICE_S)

    def _stand_aside(self) -> None:
        """Let the robots stop and give the terminal back, as Ctrl-Z asks, until continued."""
        self._suspended = False
        self._keys = replace(self._keys, key='', e_stop_until_ns=0)
        self._let_go()
        if self._terminal is not None:
            self._terminal.give_back()
        os.kill(os.getpid(), signal.SIGSTOP)
        if self._terminal is not None:
            self._terminal.take_over()

    def _stop(self, number: int, frame: object) -> None:
        self.stopped = True

    def _suspend(self, number: int, frame: object) -> None:
        self._suspended = True


def teleop(arguments: Sequence[str]) -> int:
    """Serve an operator until he ends; return the exit code.

    Raises:
        LayeredCbfError: If there is no terminal, or no such robot.
    """
    at = arguments.index(ROS_ARGUMENTS) if ROS_ARGUMENTS in arguments else len(arguments)
    options = parse(arguments[:at])
    has_terminal = is_controllable()
    if not has_terminal and not options.has_gamepad:
        raise LayeredCbfError(
            'stdin is no terminal in whose foreground this runs, so there are no keys; start '
            'teleop by hand in a terminal, or give --gamepad'
        )
    find_each_other_fast()
    with ExitStack() as stack:
        # before ROS has threads, for it starts a child
        terminal = stack.enter_context(Terminal()) if has_terminal else None
        rclpy.init(args=list(arguments[at:]), signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.try_shutdown)
        node = Node('teleop', enable_rosout=False, start_parameter_services=False)
        Teleop(node, options, terminal).run()
    return 0


def main() -> None:
    """Run the program."""
    run_verb(teleop)
