"""The nodes' computations without their nodes: recorded bytes in, what they would send out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from layered_cbf_ros.bags.resolving.rows import COMMANDS, FORCES, Content, track_row
from layered_cbf_ros.bags.resolving.run_setup import RunSetup
from layered_cbf_ros.bags.resolving.ticks import Tick
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.ground_forces.force_layer import ForceLayer, ForceMemory
from layered_cbf_ros.ground_forces.ground_force_mpc import MpcStatus
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.messages.ground_forces import GroundForceReader, GroundForceWriter
from layered_cbf_ros.messages.joint_state import JointStateWriter
from layered_cbf_ros.messages.robot_state import StateReader
from layered_cbf_ros.messages.tracks import points_from
from layered_cbf_ros.messages.trajectory import TrajectoryReader
from layered_cbf_ros.node_topics import DETECTIONS, PLAN, STATE, TRACKS
from layered_cbf_ros.perception.obstacle_tracker import ObstacleTracker
from layered_cbf_ros.perception.parameters import ObstacleTrackerParameters
from layered_cbf_ros.timing import LOCKSTEP, InputRule, InputRules
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.torque_layer import TorqueLayer, TorqueMemory

T = TypeVar('T')
Answer = tuple[str, Content]  # a topic, and what is sent there


@dataclass
class Tally:
    """What a core counts.

    Attributes:
        ticks: Ticks that it computed.
        first_ns, last_ns: Stamps of the first and the last of them [ns].
        refused: Inputs that it refused, as its node does.
        solver_failures: As on /diagnostics.
    """

    ticks: int = 0
    first_ns: int = 0
    last_ns: int = 0
    refused: int = 0
    solver_failures: int = 0

    def tick(self, stamp_ns: int, failed: bool = False) -> None:
        """Count a tick of a stamp [ns], and whether its solver failed."""
        self.first_ns = self.first_ns if self.ticks else stamp_ns
        self.last_ns = stamp_ns
        self.ticks += 1
        self.solver_failures += failed


class Core:
    """One node's computation.

    Attributes:
        node: Its name, `a1_0/ground_force_mpc` for one of a robot.
        ticking: The topic that it ticks on.
        every_ns: Period of its ticks [ns].
        rules: Of its other inputs, by topic.
        outputs: Topics it sends on; in real time the first tells when it ticked.
        is_lockstep: Whether its ticks follow stamps.
        waits_for_others: Whether in real time it has more inputs than what it ticks on.
        tally: What it counts.
    """

    node: str
    ticking: str
    every_ns: int
    rules: Mapping[str, InputRule]
    outputs: tuple[str, ...]
    is_lockstep: bool
    waits_for_others: bool
    tally: Tally

    def answers(self, tick: Tick) -> Iterator[Answer]:
        """Compute one tick; yield what its node would send."""
        raise NotImplementedError


class ForceCore(Core):
    """A robot's ground-force MPC."""

    waits_for_others = True

    def __init__(self, setup: RunSetup, node: str) -> None:
        robot, timing = node.partition('/')[0], setup.timing(node)
        self.node, self.ticking, self.every_ns = node, STATE, timing.plan_ns
        self.rules = {PLAN: InputRules(timing).plan}
        self.outputs = (f'/{robot}/{FORCES}',)
        self.is_lockstep = timing.time == LOCKSTEP
        self.tally = Tally()
        self._layer = ForceLayer(setup.parameters(node, GroundForceParameters))
        self._state, self._plan = StateReader(robot), TrajectoryReader(robot)
        self._encoder = GroundForceWriter()
        self._memory: ForceMemory | None = None

    def answers(self, tick: Tick) -> Iterator[Answer]:
        """Yield the forces."""
        state = accepted(self._state.read, tick.record.data, self.tally)
        if state is None:
            return
        plan = accepted(self._plan.read, tick.inputs[PLAN], self.tally)
        self._memory, result = self._layer.step(self._memory, state, plan)
        self.tally.tick(tick.stamp_ns, result.status is not MpcStatus.SOLVED)
        yield self.outputs[0], self._encoder.encode(result.plan)


class TorqueCore(Core):
    """A robot's whole-body controller."""

    waits_for_others = True

    def __init__(self, setup: RunSetup, node: str) -> None:
        robot, timing = node.partition('/')[0], setup.timing(node)
        rules = InputRules(timing)
        self.node, self.ticking, self.every_ns = node, STATE, timing.tick_ns
        self._forces_topic = f'/{robot}/{FORCES}'
        self.rules = {PLAN: rules.plan, self._forces_topic: rules.forces}
        self.outputs = (f'/{robot}/{COMMANDS}',)
        self.is_lockstep = timing.time == LOCKSTEP
        self.tally = Tally()
        self._layer = TorqueLayer(setup.parameters(node, WholeBodyParameters))
        self._state, self._plan = StateReader(robot), TrajectoryReader(robot)
        self._forces = GroundForceReader()
        self._encoder = JointStateWriter(JOINT_NAMES)
        self._zeros = np.zeros(len(JOINT_NAMES))
        self._memory: TorqueMemory | None = None

    def answers(self, tick: Tick) -> Iterator[Answer]:
        """Yield the torques."""
        state = accepted(self._state.read, tick.record.data, self.tally)
        if state is None:
            return
        plan = accepted(self._plan.read, tick.inputs[PLAN], self.tally)
        forces = accepted(self._forces.read, tick.inputs[self._forces_topic], self.tally)
        self._memory, result = self._layer.step(self._memory, state, plan, forces)
        self.tally.tick(tick.stamp_ns, not result.solved)
        zeros = self._zeros
        data = self._encoder.encode(state.stamp_ns, zeros, zeros, result.torques)
        yield self.outputs[0], data


class TrackerCore(Core):
    """The obstacle tracker."""

    waits_for_others = False

    def __init__(self, setup: RunSetup, node: str) -> None:
        timing = setup.timing(node)
        self.node, self.ticking, self.every_ns = node, DETECTIONS, timing.detection_ns
        self.rules = {}
        self.outputs = (TRACKS,)
        self.is_lockstep = timing.time == LOCKSTEP
        self.tally = Tally()
        self._tracker = ObstacleTracker(setup.parameters(node, ObstacleTrackerParameters))
        self._memory = self._tracker.start(0)
        self._decoder = MessageDecoder()

    def answers(self, tick: Tick) -> Iterator[Answer]:
        """Yield the tracks."""
        detections = points_from(self._decoder.decode(tick.record))
        result = self._tracker.step(self._memory, tick.stamp_ns, detections)
        self._memory = result.state
        self.tally.tick(tick.stamp_ns)
        self.tally.refused += result.rejected
        for track in result.tracks:
            yield TRACKS, track_row(track)


def accepted(read: Callable[[bytes], T], data: bytes | None, tally: Tally) -> T | None:
    """Return a decoded message; None where there is none, or it is refused as in the node."""
    if data is None:
        return None
    try:
        return read(data)
    except MessageError:
        tally.refused += 1
        return None
