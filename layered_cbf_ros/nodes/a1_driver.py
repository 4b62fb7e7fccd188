"""a1_driver: stands one A1 up, passes a controller's torques on, and protects the robot.

Disarmed it sends nothing at all. `~/arm` seizes the robot and stands it up, `~/sit_down`
lets it sit and switches its motors off, `~/reset` clears a latched fault.

  --listen-only   never send anything; tell what is heard
  --dry-run       tell on ~/would_send what would be sent; send nothing
"""

from __future__ import annotations

import contextlib
import gc
import sys
import time
from collections.abc import Callable

from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.health import Fault, Level
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.driver_inputs import DriverInputs
from layered_cbf_ros.nodes.driver_outputs import DriverOutputs
from layered_cbf_ros.nodes.ending_signals import call_on_any
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.running import EXIT_ERROR, run_node
from layered_cbf_ros.plants.a1.driver_memory import Answer, Heard, Memory, Order, Phase
from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.a1.driver_robot import DriverRobot
from layered_cbf_ros.plants.a1.driving import Driving
from layered_cbf_ros.plants.a1.orders import obey
from layered_cbf_ros.plants.a1.poses import standing_pose
from layered_cbf_ros.run_clock import RunClock

OPTIONS = {'--listen-only': 'listen_only', '--dry-run': 'dry_run'}
COUNTED_CYCLES = 500  # between two looks at the counters of the link
BEGIN_S = 0.02  # between two looks whether the run's time has begun
Service = Callable[[Trigger.Request, Trigger.Response], Trigger.Response]


class A1DriverNode(GraphNode):
    """Joins one robot's link and the graph, each millisecond, by absolute deadlines."""

    def __init__(self) -> None:
        super().__init__('a1_driver')
        robot = self.get_namespace().strip('/')
        if not robot:
            raise ParameterError('a1_driver: no robot; give one with -r __ns:=/a1_0')
        self.lockstep, self.statistics.real_time = False, True  # a robot waits for nobody
        call_on_any(self._request_stop)
        self._p = parameters = declare(self, DriverParameters)
        self._run_clock = RunClock(self.timing)
        self._driving = Driving(parameters, standing_pose(parameters.com_height))
        self._robot = DriverRobot(parameters)
        self._inputs = DriverInputs(self)
        self._outputs = DriverOutputs(self, robot, parameters.dry_run)
        self._memory, self._heard = Memory(), Heard(0)
        self._unasked = parameters.arm_at_start
        self._told = self._complained = ''
        self._offered = [
            self.create_service(Trigger, f'~/{order.value}', self._service(order))
            for order in (Order.ARM, Order.SIT_DOWN, Order.RESET)
        ]

    def run(self) -> None:
        """Drive until asked to end; then, whatever the reason is, damp and switch off."""
        gc.freeze()  # what lives by now lives on: no pause to look through it for garbage
        while self._run_clock.now_ns() < 0:
            self.serve()
            time.sleep(BEGIN_S)
        self.tell_ready()
        self.statistics.period_ns = round(self.timing.tick_ns / self.timing.pace)
        try:
            self._drive()
        finally:
            self._end()

    def close(self) -> None:
        """Let the socket go, too."""
        self._robot.close()
        super().close()

    def _drive(self) -> None:
        """Cycle by absolute deadlines; what is missed is counted, and never made up for."""
        period_ns, cycle = self.timing.tick_ns, 0
        due_ns = self._run_clock.now_ns() // period_ns * period_ns
        while True:
            due_ns += period_ns
            self._run_clock.sleep_until(due_ns)
            begun_ns = time.monotonic_ns()
            now_ns = self._run_clock.now_ns()
            missed = (now_ns - due_ns) // period_ns
            self.statistics.deadline_misses += missed
            due_ns += missed * period_ns
            self.statistics.begin(begun_ns, due_ns)
            self._cycle(now_ns, due_ns, cycle)
            if cycle % COUNTED_CYCLES == 0:
                self.statistics.details |= self._robot.counts()
            cycle += 1
            self.statistics.tick(time.monotonic_ns() - begun_ns)

    def _cycle(self, now_ns: int, stamp_ns: int, cycle: int) -> None:
        """Hear, judge, send; then tell.

        Args:
            now_ns: Time by which everything is judged [ns].
            stamp_ns: The deadline that it was for: stamps that are a period apart [ns].
            cycle: Number of cycles so far.
        """
        state = self._robot.receive(now_ns)
        if state is not None:
            self._outputs.publish_measured(stamp_ns, state)
        refused = self._inputs.take_command(now_ns)
        self._heard = Heard(
            now_ns,
            self._robot.state,
            self._robot.state_ns,
            state is not None,
            self._robot.buttons,
            self._inputs.command,
            refused,
            self._inputs.take_emergency_stop(),
        )
        self._arm_unasked()
        self._memory, command = self._driving.step(self._memory, self._heard)
        if command is not None:
            self._robot.send(command)
            self._outputs.publish_sent(stamp_ns, command)
        self._tell()
        if not self._outputs.is_for_people(cycle):
            self.serve()  # not in the same cycle: together they could make it late
        elif self._robot.state is not None:
            self._outputs.publish_for_people(cycle, stamp_ns, self._robot.state)

    def _arm_unasked(self) -> None:
        """Arm an emulated robot as often as it takes until it answers; once it did, never."""
        if self._unasked and self._memory.phase is Phase.DISARMED and not self._memory.fault:
            self._obey(Order.ARM)
        self._unasked &= self._memory.phase in (Phase.DISARMED, Phase.ENGAGING)

    def _obey(self, order: Order) -> Answer:
        self._memory, answer = obey(self._driving, self._p, self._memory, order, self._heard)
        return answer

    def _service(self, order: Order) -> Service:
        """Return what answers the service of an order."""

        def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            answered = self._obey(order)
            response.success, response.message = answered.success, answered.message
            return response

        return answer

    def _tell(self) -> None:
        """Tell what the driver does when that changes, and why it gave up."""
        trouble, phase = self._memory.trouble, self._memory.phase.value
        words = f'{phase}: {trouble}' if trouble else phase
        if words == self._told:
            return
        self._told = words
        self._outputs.tell(words)
        self.statistics.faults = (Fault('driver', Level.ERROR, trouble),) if trouble else ()
        self.statistics.details |= {'driver': phase, 'fault': trouble}
        if trouble and trouble != self._complained:
            self._complained = trouble
            with contextlib.suppress(OSError):  # nobody reads it any more: the robot comes first
                name = self.get_fully_qualified_name()
                print(f'ERROR {name}: {words}', file=sys.stderr, flush=True)

    def _end(self) -> None:
        """Damp and switch off, by nothing but the clock and the link."""
        self._obey(Order.END)
        while self._memory.phase is not Phase.DISARMED:
            now_ns = self._run_clock.now_ns()
            self._memory, command = self._driving.step(self._memory, Heard(now_ns))
            if command is not None:
                self._robot.send(command)
            self._tell()
            self._run_clock.sleep_until(now_ns + self.timing.tick_ns)


def main() -> None:
    """Run the node; its two options are parameters that one would not want to misspell."""
    for argument in remove_ros_args(sys.argv)[1:]:
        if argument in OPTIONS:
            sys.argv += ['--ros-args', '-p', f'{OPTIONS[argument]}:=true']
        elif argument not in ('-h', '--help'):
            print(f'ERROR a1_driver: unknown option {argument}; see --help', file=sys.stderr)
            sys.exit(EXIT_ERROR)
    run_node(A1DriverNode)
