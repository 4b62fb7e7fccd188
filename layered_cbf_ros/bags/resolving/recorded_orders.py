"""What operators and planners asked of the coordinator at each recorded tick."""

from __future__ import annotations

from collections.abc import Sequence

from layered_cbf_ros.bags.run.series import JointTrajectories
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.node_topics import COMMANDS
from layered_cbf_ros.operation.orders import Orders, no_orders
from layered_cbf_ros.operation.told import read_told

VELOCITY, EFFORT = 1, 3  # rows of what a tick is told in


class RecordedOrders:
    """The orders of every tick; nothing is asked before the first that was told."""

    def __init__(self, bag: Bag, robots: Sequence[str]) -> None:
        """Read them all: few numbers, for they come in batches.

        Raises:
            BagError, MessageError: If a message is malformed.
        """
        self._path, self._robots = bag.path, tuple(robots)
        self._told: dict[int, tuple[tuple[str, ...], Array]] = {}
        if COMMANDS in bag.topics:
            reader = JointTrajectories()
            for record in bag.records({COMMANDS}):
                names, stamps, values = reader.read(record.data)
                for stamp_ns, value in zip(stamps, values, strict=True):
                    self._told[stamp_ns] = names, value[(VELOCITY, EFFORT), :]
        self._first_ns, self._last_ns = min(self._told, default=0), max(self._told, default=-1)

    def at(self, stamp_ns: int) -> Orders:
        """Return the orders of a tick.

        Raises:
            BagError: If they were told before and after it, but not of it.
        """
        told = self._told.get(stamp_ns)
        if told is not None:
            names, (velocities, effort) = told
            return Orders(stamp_ns, *read_told(names, velocities, effort, self._robots))
        if self._first_ns < stamp_ns <= self._last_ns:
            raise BagError(
                f'{self._path}: {COMMANDS} lacks stamp {stamp_ns / NS_PER_S:.3f} s: the '
                'coordinator was steered, so nothing after it can be re-solved'
            )
        return no_orders(stamp_ns, len(self._robots))
