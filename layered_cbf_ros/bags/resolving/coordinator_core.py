"""The coordinator's computation without its node, by what was recorded or by its own plan."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from layered_cbf_ros.bags.resolving.cores import Answer, Core, Tally
from layered_cbf_ros.bags.resolving.recorded_orders import RecordedOrders
from layered_cbf_ros.bags.resolving.rows import series_row
from layered_cbf_ros.bags.resolving.run_setup import RunSetup
from layered_cbf_ros.bags.resolving.teams import team_of
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
from layered_cbf_ros.messages.trajectory import TrajectoryWriter
from layered_cbf_ros.node_topics import BARRIERS, DESIRED, INTERVENTION, PLAN, TRACKS
from layered_cbf_ros.operation.orders import Orders
from layered_cbf_ros.timing import LOCKSTEP, InputRules


class CoordinatorCore(Core):
    """The coordinator."""

    waits_for_others = True

    def __init__(
        self,
        setup: RunSetup,
        node: str,
        orders: RecordedOrders,
        filtered: bool = True,
        obeyed: bool = False,
    ) -> None:
        """Make the coordinator as its node does.

        Args:
            setup: Of the run.
            node: Its name.
            orders: What was asked of it.
            filtered: False takes the desired motion as it is.
            obeyed: Whether all robots are taken to follow the plan exactly, upright,
                instead of doing what was recorded.
        """
        timing, scenario = setup.timing(node), setup.scenario
        self.is_lockstep = timing.time == LOCKSTEP
        self.tally = Tally()
        self._team = team_of(setup, node, self.tally)
        self.node, self.ticking, self.every_ns = node, self._team.ticking, timing.tick_ns
        tracks = {TRACKS: InputRules(timing).tracks} if scenario.obstacles else {}
        self.rules = {**self._team.rules, **tracks}
        self.outputs = (PLAN, BARRIERS, INTERVENTION, DESIRED, *self._team.outputs)
        self.parameters = setup.parameters(node, CoordinatorParameters)
        self._layer = CoordinationLayer(
            self.parameters, scenario.robots, scenario.walls, timing.state_rate, filtered
        )
        self._plan_ns, self._obeyed = timing.plan_ns, obeyed
        self._encoder = TrajectoryWriter(setup.robots)
        self._robots, self._axes = setup.robots, axis_names(setup.robots)
        self._tracks: tuple[Track, ...] = ()
        self._memory: CoordinationState | None = None
        self._orders = orders

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
        if not self._obeyed:
            yield from self._team.answers(result)

    def _result(self, tick: Tick) -> CoordinationResult | None:
        """Return the result of a tick, None if no state is known."""
        if tick.inputs.get(TRACKS) is not None:
            self._tracks = tick.inputs[TRACKS]
        if self._obeyed and self._memory is not None:
            orders = self._orders.at(tick.stamp_ns)
            inputs = obeyed(self._memory, tick.stamp_ns, self._tracks, orders)
            return self._layer.act(self._memory, inputs)
        orders = self._orders.at(tick.stamp_ns)
        heard = self._team.inputs(self._layer, tick, self._tracks, orders)
        if heard is None:
            return None
        result = self._layer.act(self._memory, heard)
        self.tally.refused += result.rejected - self._team.refused()
        return result


def obeyed(
    memory: CoordinationState, stamp_ns: int, tracks: tuple[Track, ...], orders: Orders
) -> CoordinationInputs:
    """Return the inputs of robots that follow their plan exactly, and never fall."""
    count = len(memory.yaws)
    return CoordinationInputs(
        stamp_ns,
        memory.positions,
        memory.velocities,
        np.zeros(count, dtype=bool),
        tracks,
        orders.commands,
        memory.yaws,
        orders.stopped,
    )
