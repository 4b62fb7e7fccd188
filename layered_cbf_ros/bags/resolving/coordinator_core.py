"""The coordinator's computation without its node, by what was recorded or by its own plan."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from layered_cbf_ros.bags.resolving.cores import Answer, Core, Tally, accepted
from layered_cbf_ros.bags.resolving.rows import series_row
from layered_cbf_ros.bags.resolving.run_setup import RunSetup
from layered_cbf_ros.bags.resolving.ticks import Tick
from layered_cbf_ros.coordination.coordination_layer import (
    CoordinationLayer,
    axis_names,
    barriers,
    interventions,
    wishes,
)
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.plan import CoordinationState
from layered_cbf_ros.interfaces import Track
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.messages.trajectory import TrajectoryWriter
from layered_cbf_ros.node_topics import BARRIERS, DESIRED, INTERVENTION, PLAN, STATE, TRACKS
from layered_cbf_ros.timing import LOCKSTEP, InputRules


class CoordinatorCore(Core):
    """The coordinator."""

    waits_for_others = True

    def __init__(
        self, setup: RunSetup, node: str, filtered: bool = True, obeyed: bool = False
    ) -> None:
        """Make the coordinator as its node does.

        Args:
            setup: Of the run.
            node: Its name.
            filtered: False takes the desired motion as it is.
            obeyed: Whether all robots are taken to follow the plan exactly, upright,
                instead of doing what was recorded.
        """
        timing, scenario = setup.timing(node), setup.scenario
        self.node, self.ticking, self.every_ns = node, STATE, timing.tick_ns
        self.rules = {TRACKS: InputRules(timing).tracks} if scenario.obstacles else {}
        self.outputs = (PLAN, BARRIERS, INTERVENTION, DESIRED)
        self.is_lockstep = timing.time == LOCKSTEP
        self.tally = Tally()
        self.parameters = setup.parameters(node, CoordinatorParameters)
        self._layer = CoordinationLayer(
            self.parameters, scenario.robots, scenario.walls, timing.state_rate, filtered
        )
        self._plan_ns, self._obeyed = timing.plan_ns, obeyed
        self._states = [StateReader(name) for name in setup.robots]
        self._encoder = TrajectoryWriter(setup.robots)
        self._robots, self._axes = setup.robots, axis_names(setup.robots)
        self._tracks: tuple[Track, ...] = ()
        self._memory: CoordinationState | None = None

    def answers(self, tick: Tick) -> Iterator[Answer]:
        """Yield the plan, where it is due, and what is told of the tick."""
        result = self._result(tick)
        if result is None:
            return
        self._memory = result.state
        self.tally.tick(tick.stamp_ns, result.solver_failed)
        stamp_ns = result.motions[0].stamp_ns
        if stamp_ns % self._plan_ns == 0 or not self.is_lockstep:
            yield PLAN, self._encoder.encode(stamp_ns, result.motions)
        yield INTERVENTION, series_row(stamp_ns, self._robots, interventions(result))
        yield DESIRED, series_row(stamp_ns, self._axes, wishes(result))
        if result.labels:
            yield BARRIERS, series_row(stamp_ns, result.labels, barriers(result))

    def _result(self, tick: Tick) -> CoordinationResult | None:
        """Return the result of a tick, None if no state is known."""
        if tick.inputs.get(TRACKS) is not None:
            self._tracks = tick.inputs[TRACKS]
        if self._obeyed and self._memory is not None:
            inputs = obeyed(self._memory, tick.stamp_ns, self._tracks)
            return self._layer.act(self._memory, inputs)
        data, tally = tick.record.data, self.tally
        states = [accepted(reader.read, data, tally) for reader in self._states]
        if all(state is None for state in states):
            return None
        inputs = self._layer.inputs(tick.stamp_ns, states, self._tracks)
        result = self._layer.act(self._memory, inputs)
        tally.refused += result.rejected - states.count(None)
        return result


def obeyed(
    memory: CoordinationState, stamp_ns: int, tracks: tuple[Track, ...]
) -> CoordinationInputs:
    """Return the inputs of robots that follow their plan exactly, and never fall."""
    count = len(memory.yaws)
    return CoordinationInputs(
        stamp_ns,
        memory.positions,
        memory.velocities,
        np.zeros(count, dtype=bool),
        tracks,
        (None,) * count,
        memory.yaws,
    )
