"""One input of a node besides the state: which of its messages a tick uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from trajectory_msgs.msg import MultiDOFJointTrajectory

from layered_cbf_ros.interfaces import PlannedMotion
from layered_cbf_ros.messages.trajectory import TrajectoryReader
from layered_cbf_ros.node_topics import PLAN
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.transport import Reader
from layered_cbf_ros.timing import Inbox, InputRule

T = TypeVar('T')


class Input(Generic[T]):
    """One input besides the state: fetched by the timing rule, decoded, refused if bad.

    Args:
        node: Whose input it is.
        reader: Where its messages come from.
        rule: How old it is when it is used.
        decode: Returns the core type, or raises MessageError.
        sender: Whom to name if it does not come.
        poll_ns: How long to take by polling before blocking [ns].
    """

    def __init__(
        self,
        node: GraphNode,
        reader: Reader,
        rule: InputRule,
        decode: Callable[[bytes], T],
        sender: str,
        poll_ns: int = 0,
    ) -> None:
        self._node = node
        self._reader = reader
        self._rule = rule
        self._decode = decode
        self._sender = sender
        self._poll_ns = poll_ns
        self._inbox = Inbox()
        self._decoded: tuple[bytes | None, T | None] = (None, None)

    def at(self, tick_ns: int) -> T | None:
        """Return the input that a tick uses, None if there is none (yet, or any more)."""
        if self._node.lockstep:
            wanted = self._rule.wanted(tick_ns)
            data = None if wanted is None else self._wait_for(wanted)
        else:
            data = self._newest(tick_ns)
            if data is None:
                self._node.statistics.miss_input(self._sender)
        if data is not self._decoded[0]:
            value = (
                None if data is None else self._node.accept(self._decode, data, self._reader.topic)
            )
            self._decoded = (data, value)
        return self._decoded[1]

    def _offer(self, data: bytes) -> None:
        self._node.accept(self._inbox.offer, data, self._reader.topic)

    def _wait_for(self, stamp_ns: int) -> bytes:
        found = self._inbox.exactly(stamp_ns)
        give_up_ns = self._node.begin_wait()
        while found is None:
            data = self._reader.poll(self._poll_ns)
            if data is None:
                self._node.wait(self._reader, give_up_ns, self._sender)
                continue
            self._offer(data)
            found = self._inbox.exactly(stamp_ns)
        return found

    def _newest(self, tick_ns: int) -> bytes | None:
        while (data := self._reader.take()) is not None:
            self._offer(data)
        for _ in range(self._inbox.drop_after(tick_ns + self._rule.period_ns)):
            self._node.statistics.reject(f'{self._reader.topic}: stamp in the future')
        return self._inbox.newest(tick_ns, self._rule.age_limit_ns)


def plan_input(node: GraphNode, robot: str) -> Input[PlannedMotion]:
    """Return the input that both controllers of a robot have: its safe motion."""
    reader = node.reader(MultiDOFJointTrajectory, PLAN)
    return Input(node, reader, node.rules.plan, TrajectoryReader(robot).read, '/coordinator')
