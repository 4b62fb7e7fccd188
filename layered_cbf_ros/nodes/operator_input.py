"""What operators and planners ask of the coordinator: joysticks, cmd_vel, the emergency stop."""

from __future__ import annotations

import math
import time
from functools import partial

from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, Header
from std_srvs.srv import Trigger

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.node_topics import E_STOP, JOY, cmd_vel
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.inputs import Input
from layered_cbf_ros.nodes.transport import Reader, decoded
from layered_cbf_ros.operation.desk import Asked, Desk, Now, asked, heard, released, reset, stopped
from layered_cbf_ros.operation.joystick import read_joy
from layered_cbf_ros.operation.orders import Orders, no_orders, ordered
from layered_cbf_ros.operation.parameters import JoystickParameters
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_operator import SOURCE

PERIOD_NS = 10_000_000  # of looking for messages, in the run's time
OLD_NS = 250_000_000  # beyond this a stamp is from another time, or another clock
FOREIGN_FRAMES = ('world', 'map', 'odom')


class OperatorInput:
    """Turns Joy, TwistStamped and the emergency stop into the orders of each tick."""

    def __init__(
        self,
        node: GraphNode,
        scenario: Scenario,
        parameters: JoystickParameters,
        limits: tuple[float, float],
    ) -> None:
        """Subscribe.

        Args:
            node: The coordinator.
            scenario: Its robots, and whether a script steers them.
            parameters: Layout of the joystick, limits, time-outs.
            limits: Largest speed [m/s] and yaw rate [rad/s] of a planner's wish.
        """
        self._node, self._parameters, self._limits = node, parameters, limits
        self._robots = [robot.name for robot in scenario.robots]
        self._joy = Reader(node, Joy, JOY)
        self._stop = Reader(node, Bool, E_STOP)
        self._planners = [Reader(node, TwistStamped, cmd_vel(name)) for name in self._robots]
        self._script: Input[Joy] | None = None
        if scenario.operator:
            reader = ScriptReader(node, Joy, JOY)
            node.readers.append(reader)
            rule = node.rules.operator
            self._script = Input(node, reader, rule, lambda data: decoded(data, Joy), '/simulator')
        node.create_service(Trigger, '/coordinator/reset_e_stop', self._reset)
        self._timeout_ns = round(parameters.joy_timeout * NS_PER_S)
        self._stamps: dict[str, int] = {}
        self._followed: Joy | None = None
        self._clamped = ''
        self._next_ns = 0
        self.desk = Desk()
        self._orders = no_orders(0, len(self._robots))

    def at(self, tick_ns: int) -> Orders:
        """Return the orders of a tick."""
        now = Now(tick_ns, time.monotonic_ns())
        if self._script is not None:
            self._follow_script(now)
        if tick_ns >= self._next_ns:
            self._next_ns = tick_ns + PERIOD_NS
            self._listen(now)
        if self.desk.is_idle:
            self._orders = no_orders(tick_ns, len(self._robots))
        else:
            self.desk = released(self.desk, now, self._timeout_ns)
            self._orders = ordered(self._orders, self.desk, now, self._parameters)
        return self._orders

    def details(self) -> dict[str, str]:
        """Return what /diagnostics tells of the operator."""
        desk = self.desk
        return {
            'operator': desk.owner,
            'steered': ', '.join(self._robots[k] for k in desk.steered),
            'e_stop': 'latched' if desk.stopped else '',
            'clamped': str(desk.clamped),
            'last_clamped': self._clamped,
        }

    def _listen(self, now: Now) -> None:
        """Take what has come since the last time."""
        while (data := self._stop.take()) is not None:
            pressed = self._node.accept(lambda bytes_: decoded(bytes_, Bool).data, data)
            if pressed:
                self.desk = stopped(self.desk)
        while (data := self._joy.take()) is not None:
            self._node.accept(lambda bytes_: self._hear(decoded(bytes_, Joy), now, False), data)
        for robot, reader in enumerate(self._planners):
            newest = None
            while (data := reader.take()) is not None:
                newest = data
            if newest is not None:
                self._node.accept(partial(self._ask, robot, now), newest)

    def _follow_script(self, now: Now) -> None:
        """Take the script's message that this tick wants."""
        joy = self._script.at(now.run_ns) if self._script is not None else None
        if joy is not None and joy is not self._followed:
            self._followed = joy
            self._hear(joy, now, True)

    def _hear(self, joy: Joy, now: Now, scripted: bool) -> None:
        """Take a Joy message.

        Raises:
            MessageError: If it is malformed, old, or from a second operator.
        """
        name = joy.header.frame_id or 'joy'
        if (name == SOURCE) is not scripted:
            return
        if not scripted:
            self._check_stamp(name, time_of(joy.header), now)
        count = len(self._robots)
        hands = read_joy(name, joy.axes, joy.buttons, self._parameters, count)
        self.desk, refusal = heard(self.desk, name, hands, now, count, self._timeout_ns, scripted)
        if refusal:
            raise MessageError(refusal)

    def _check_stamp(self, name: str, stamp_ns: int, now: Now) -> None:
        """Refuse what was sent long ago; a stamp of zero says nothing.

        Raises:
            MessageError: If the stamp is old by the wall's clock and by the run's.
        """
        if stamp_ns == 0:
            return
        late_ns = min(abs(clock - stamp_ns) for clock in (time.time_ns(), now.run_ns))
        if late_ns > max(self._timeout_ns, OLD_NS):
            raise MessageError(
                f"message from '{name}' is stamped {late_ns / NS_PER_S:.2f} s from now; "
                'let the clocks agree, or stamp it with 0'
            )
        before_ns = self._stamps.get(name, 0)
        if stamp_ns < before_ns and before_ns - stamp_ns < OLD_NS:
            raise MessageError(f"message from '{name}' is older than the one before")
        self._stamps[name] = stamp_ns

    def _ask(self, robot: int, now: Now, data: bytes) -> None:
        """Take a planner's wish.

        Raises:
            MessageError: If it is malformed, old, not finite, or not in the robot's frame.
        """
        name, message = self._robots[robot], decoded(data, TwistStamped)
        topic, frame = cmd_vel(name), message.header.frame_id
        twist = message.twist
        x, y, yaw_rate = twist.linear.x, twist.linear.y, twist.angular.z
        if not math.isfinite(x + y + yaw_rate):
            raise MessageError(f'{topic} has a value that is not finite')
        if frame.rpartition('/')[2] in FOREIGN_FRAMES:
            raise MessageError(
                f"{topic} is in frame '{frame}'; give velocities in the robot's own frame"
            )
        self._check_stamp(topic, stamp_of(data), now)
        before = self.desk.clamped
        self.desk = asked(self.desk, robot, Asked(x, y, yaw_rate, now.wall_ns), self._limits)
        if self.desk.clamped > before:
            fastest, turning = self._limits
            self._clamped = (
                f'{topic} asks for {math.hypot(x, y):.2f} m/s, {yaw_rate:.2f} rad/s: '
                f'clamped to {fastest:g} m/s, {turning:g} rad/s'
            )

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """End an emergency stop."""
        response.success = self.desk.stopped
        response.message = 'robots stand up' if self.desk.stopped else 'there was no emergency stop'
        self.desk = reset(self.desk)
        return response


class ScriptReader(Reader):
    """Takes a scripted operator's Joy messages, and no others."""

    def take(self) -> bytes | None:
        """Return the oldest message of the script that waits."""
        while (data := super().take()) is not None:
            if SOURCE.encode() in data:
                return data
        return None


def time_of(header: Header) -> int:
    """Return the stamp of a header [ns]."""
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)
