"""What the coordinator's core hears from the robots of a recorded run, and tells them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

from layered_cbf_ros.bags.resolving.cores import Answer, Tally, accepted
from layered_cbf_ros.bags.resolving.run_setup import RunSetup
from layered_cbf_ros.bags.resolving.ticks import Tick
from layered_cbf_ros.coordination.coordination_layer import CoordinationLayer
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.coordination.fleet import Fleet
from layered_cbf_ros.coordination.fleet_parameters import FleetParameters
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import BaseState, Track
from layered_cbf_ros.messages.odometry import OdometryReader, base_frame
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.messages.twist import TwistWriter
from layered_cbf_ros.node_topics import STATE, cmd_vel_safe, odometry
from layered_cbf_ros.operation.orders import Orders
from layered_cbf_ros.scenario import BASES
from layered_cbf_ros.timing import LOCKSTEP, InputRule


class Team(Protocol):
    """The robots of a run, tick by tick.

    Attributes:
        ticking: The topic that the coordinator ticks on.
        rules: Of the other topics that tell where robots are, by topic.
        outputs: Topics on which robots are told something, besides the plan.
    """

    ticking: str
    rules: Mapping[str, InputRule]
    outputs: tuple[str, ...]

    def inputs(
        self, layer: CoordinationLayer, tick: Tick, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs | None:
        """Return what the coordinator is told at a tick, None if no state is known."""

    def refused(self) -> int:
        """Return of how many robots nothing is known at this tick."""

    def answers(self, result: CoordinationResult) -> Iterator[Answer]:
        """Yield what is sent to the robots, besides the plan."""


class LeggedTeam:
    """Robots whose states come in one message."""

    ticking = STATE
    rules: Mapping[str, InputRule] = {}
    outputs: tuple[str, ...] = ()

    def __init__(self, robots: list[str], tally: Tally) -> None:
        self._readers, self._tally = [StateReader(name) for name in robots], tally
        self._unknown = 0

    def inputs(
        self, layer: CoordinationLayer, tick: Tick, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs | None:
        """Return what the coordinator is told at a tick, None if no state is known."""
        states = [accepted(reader.read, tick.record.data, self._tally) for reader in self._readers]
        self._unknown = states.count(None)
        if self._unknown == len(states):
            return None
        return layer.inputs(tick.stamp_ns, states, tracks, orders.commands, orders.stopped)

    def refused(self) -> int:
        """Return how many states of this tick were refused."""
        return self._unknown

    def answers(self, result: CoordinationResult) -> Iterator[Answer]:
        """Yield nothing."""
        yield from ()


class FleetTeam:
    """Bases: each tells its odometry, and is told its safe velocity."""

    def __init__(self, setup: RunSetup, node: str, tally: Tally) -> None:
        """Begin.

        Raises:
            BagError: If the run was in real time.
        """
        timing, robots = setup.timing(node), setup.scenario.robots
        if timing.time != LOCKSTEP:
            raise BagError(
                f'{node} of a fleet in real time ticks by its own clock, on no message: which '
                'odometry a tick used is not recorded; re-solve a run in lockstep'
            )
        parameters = setup.parameters(node, FleetParameters)
        names = setup.robots
        self._fleet = Fleet(robots, parameters, setup.parameters(node, CoordinatorParameters))
        self._decoders = [OdometryReader(name, parameters.world_frame) for name in names]
        self._encoders = [TwistWriter(base_frame(name)) for name in names]
        self._topics, self._tally = [odometry(name) for name in names], tally
        self._points: list[BaseState | None] = []
        rule = InputRule(timing.tick_ns, 0, timing.tick_ns)
        self.ticking = self._topics[0]
        self.rules: Mapping[str, InputRule] = dict.fromkeys(self._topics[1:], rule)
        self.outputs = tuple(cmd_vel_safe(name) for name in names)

    def inputs(
        self, layer: CoordinationLayer, tick: Tick, tracks: tuple[Track, ...], orders: Orders
    ) -> CoordinationInputs | None:
        """Return what the coordinator is told at a tick."""
        received = [tick.record.data, *(tick.inputs[topic] for topic in self._topics[1:])]
        bases = [
            accepted(decoder.read, data, self._tally)
            for decoder, data in zip(self._decoders, received, strict=True)
        ]
        self._points = self._fleet.coordinated(bases)
        return layer.inputs_of_bases(
            tick.stamp_ns, self._points, tracks, orders.commands, orders.stopped
        )

    def refused(self) -> int:
        """Return how many messages of this tick were refused."""
        return self._points.count(None)

    def answers(self, result: CoordinationResult) -> Iterator[Answer]:
        """Yield the velocities."""
        stamp_ns = result.motions[0].stamp_ns
        told = self._fleet.commands(result, self._points)
        for topic, encoder, velocity in zip(self.outputs, self._encoders, told, strict=True):
            yield topic, encoder.encode(stamp_ns, velocity)


def team_of(setup: RunSetup, node: str, tally: Tally) -> Team:
    """Return the robots of a run."""
    if setup.scenario.plant == BASES:
        return FleetTeam(setup, node, tally)
    return LeggedTeam(setup.robots, tally)
