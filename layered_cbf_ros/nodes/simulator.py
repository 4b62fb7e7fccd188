"""simulator: A1s or bases, and scripted obstacles; the source of time in simulation."""

from __future__ import annotations

import time

from std_msgs.msg import Header, String

from layered_cbf_ros.errors import MissingInputError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.nodes.fleet_plant import FleetPlant
from layered_cbf_ros.nodes.graph_node import SLICE_S
from layered_cbf_ros.nodes.running import run_node
from layered_cbf_ros.nodes.scenario_node import ScenarioNode
from layered_cbf_ros.nodes.simulated_plant import SimulatedPlant
from layered_cbf_ros.nodes.simulator_pause import SimulatorPause
from layered_cbf_ros.nodes.transport import Reader, decoded, latched
from layered_cbf_ros.plants.goals import GoalWatch
from layered_cbf_ros.scenario import BASES

MANY = 1000  # nodes whose latched word is kept
RECORDER_WINDOW_NS = 60_000_000  # what every publisher still has, should it be lost on the way
START_LIMIT_NS = 60_000_000_000
LATE_NS = 100_000_000  # beyond this the real-time schedule starts anew


class SimulatorNode(ScenarioNode):
    """Steps the world with the commands of every robot."""

    def __init__(self) -> None:
        super().__init__('simulator')
        self._plant = self._make_plant()
        self._goals = GoalWatch(self._scenario)
        self._pause = SimulatorPause(self)
        self._progress = Reader(self, Header, '/recorder/progress') if self.recorded else None
        self._recorded_ns = 0
        self._absent = set(self.declare_parameter('wait_for', ['']).value) - {''}
        self._ready_words = Reader(self, String, '/ready', latched(MANY))

    def run(self) -> None:
        """Step the world until every goal is reached or the scenario's time is over."""
        self.become_ready()
        self._wait_for_all()
        self.statistics.period_ns = self.timing.tick_ns
        end_ns = round(self._scenario.duration * NS_PER_S)
        begin_ns = time.monotonic_ns()
        while self._plant.stamp_ns <= end_ns and not self._goals.all_reached:
            self.serve()
            self._pause.hold(self._plant.stamp_ns)
            self.statistics.begin(time.monotonic_ns(), self._plant.stamp_ns)
            begun_ns = time.perf_counter_ns()
            self._goals.watch(self._plant.stamp_ns, self._plant.publish())
            used_ns = time.perf_counter_ns() - begun_ns
            self._plant.hear()
            begun_ns = time.perf_counter_ns()
            self._plant.advance()
            self.statistics.tick(used_ns + time.perf_counter_ns() - begun_ns)
            if self.lockstep:
                self._wait_for_recorder(RECORDER_WINDOW_NS)
            else:
                begin_ns = self._wait_for_deadline(begin_ns)
        self._wait_for_recorder(self.timing.tick_ns)

    def on_silence(self) -> None:
        """Send the last states again: who has them already sends its answers again."""
        self.resend()

    def _make_plant(self) -> SimulatedPlant:
        """Return the plant; who has no legs needs no physics engine."""
        if self._scenario.plant == BASES:
            return FleetPlant(self, self._scenario)
        from layered_cbf_ros.nodes.legged_plant import LeggedPlant

        return LeggedPlant(self, self._scenario)

    def _wait_for_deadline(self, begin_ns: int) -> int:
        """Sleep until the next state is due; return the schedule's (new) begin [ns]."""
        late_ns = time.monotonic_ns() - begin_ns - self._plant.stamp_ns
        if late_ns < 0:
            time.sleep(-late_ns * 1e-9)
            return begin_ns
        self.statistics.deadline_misses += 1
        return begin_ns + late_ns if late_ns > LATE_NS else begin_ns

    def _wait_for_recorder(self, window_ns: int) -> None:
        """Let the recorder catch up: what isn't recorded can't be proven.

        Raises:
            MissingInputError: If it stops writing.
        """
        if self._progress is None:
            return
        give_up_ns = self.begin_wait()
        while self._plant.stamp_ns - self._recorded_ns > window_ns:
            self.serve()
            data = self._progress.take()
            if data is not None:
                self._recorded_ns = max(self._recorded_ns, stamp_of(data))
            elif time.monotonic_ns() > give_up_ns:
                raise MissingInputError(f'MISSING /recorder: nothing on {self._progress.topic}')
            else:
                self.statistics.wait_for('/recorder', time.monotonic_ns())
                self._progress.wait(SLICE_S)

    def _wait_for_all(self) -> None:
        """Wait until every node of the run is ready.

        Raises:
            MissingInputError: If somebody does not become ready in time.
        """
        give_up_ns = time.monotonic_ns() + START_LIMIT_NS
        while self._absent:
            while (data := self._ready_words.take()) is not None:
                word = self.accept(lambda bytes_: decoded(bytes_, String).data, data)
                self._absent.discard(word or '')
            self.statistics.wait_for(', '.join(sorted(self._absent)), time.monotonic_ns())
            self.serve()
            time.sleep(0.2 * SLICE_S)
            if time.monotonic_ns() > give_up_ns:
                raise MissingInputError(f'MISSING {min(self._absent)}: not ready')
        self.statistics.waiting_for = ''


def main() -> None:
    """Run the node."""
    run_node(SimulatorNode)
