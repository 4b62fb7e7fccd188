"""One way of a bad link: packets come late, never, twice, in another order, or spoilt."""

from __future__ import annotations

import heapq
from typing import Generic, TypeVar

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.scenario_emulation import Emulation

A = TypeVar('A')
OVERTAKEN_NS = 3_000_000
"""How much later than its turn a packet comes that others overtake [ns]."""


class Channel(Generic[A]):
    """A queue by the run's time; chance decides what becomes of each packet."""

    def __init__(self, emulation: Emulation, rng: np.random.Generator) -> None:
        """Prepare.

        Args:
            emulation: Latency and probabilities.
            rng: Of this way alone.
        """
        self._e, self._rng = emulation, rng
        self._waiting: list[tuple[int, int, bytes, A]] = []
        self._last_ns, self._count = 0, 0

    def put(self, now_ns: int, packet: bytes, label: A) -> None:
        """Send a packet on its way.

        Args:
            now_ns: When [ns].
            packet: Its bytes.
            label: What belongs to it, as its sender.
        """
        e = self._e
        lost, doubled, overtaken, spoilt, late = self._rng.random(5)
        if lost < e.loss:
            return
        if spoilt < e.corruption:
            packet = self._spoilt(packet)
        delay_ns = round((e.latency + late * e.jitter) * NS_PER_S)
        due_ns = max(now_ns + delay_ns, self._last_ns)  # who only varies does not overtake
        if overtaken < e.reordering:
            due_ns += OVERTAKEN_NS
        else:
            self._last_ns = due_ns
        for _ in range(1 + (doubled < e.duplication)):
            self._count += 1
            heapq.heappush(self._waiting, (due_ns, self._count, packet, label))

    def due(self, now_ns: int) -> list[tuple[bytes, A]]:
        """Return the packets that have arrived by now, in the order in which they did."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            _, _, packet, label = heapq.heappop(self._waiting)
            arrived.append((packet, label))
        return arrived

    def _spoilt(self, packet: bytes) -> bytes:
        data = bytearray(packet)
        data[self._rng.integers(len(data))] ^= 1 << int(self._rng.integers(8))
        return bytes(data)
