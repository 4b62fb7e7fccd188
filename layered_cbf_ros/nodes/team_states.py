"""What the coordinator asks of its source of states; and the source for robots with legs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from layered_cbf_ros.coordination.coordination_layer import CoordinationLayer
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.interfaces import RobotState, Track
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.operation.orders import Orders


class TeamStates(Protocol):
    """Where the robots are, tick by tick."""

    @property
    def unknown(self) -> int:
        """Return of how many robots nothing is known at this tick."""

    def ticks(self) -> Iterator[int]:
        """Yield the stamp of each tick [ns]."""

    def inputs(
        self, layer: CoordinationLayer, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs:
        """Return what the coordinator is told at this tick."""

    def answer(self, result: CoordinationResult) -> None:
        """Send what robots are told besides the plan."""


class LeggedStates:
    """The robots' states come together, in one message; the plan is all they are told."""

    def __init__(self, node: GraphNode, robots: Sequence[str]) -> None:
        self._node = node
        self._readers = [StateReader(name) for name in robots]
        self._stamp_ns = 0
        self._states: list[RobotState | None] = []

    @property
    def unknown(self) -> int:
        """Return how many states of this tick were refused."""
        return self._states.count(None)

    def ticks(self) -> Iterator[int]:
        """Yield the stamp of each message in which at least one state is sound [ns]."""
        for data in self._node.ticks(self._node.timing.tick_ns):
            self._states = [self._node.accept(reader.read, data) for reader in self._readers]
            known = [state for state in self._states if state is not None]
            if known:
                self._stamp_ns = known[0].stamp_ns
                yield self._stamp_ns

    def inputs(
        self, layer: CoordinationLayer, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs:
        """Return what the coordinator is told at this tick."""
        return layer.inputs(self._stamp_ns, self._states, tracks, orders.commands, orders.stopped)

    def answer(self, result: CoordinationResult) -> None:
        """Do nothing."""
