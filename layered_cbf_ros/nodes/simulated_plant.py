"""What the simulator asks of a plant, whichever robots are in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from layered_cbf_ros.interfaces import Array


class SimulatedPlant(Protocol):
    """A world with its topics.

    A tick is `publish`, `hear`, `advance`; its time is that of the world.
    """

    @property
    def stamp_ns(self) -> int:
        """Time of the present state [ns]."""

    def publish(self) -> Sequence[Array]:
        """Publish what is due now; return where each robot is in the plane [m], (2,)."""

    def hear(self) -> None:
        """Take the commands of this tick; in lockstep, wait for them."""

    def advance(self) -> None:
        """Go on by one tick with these commands."""
