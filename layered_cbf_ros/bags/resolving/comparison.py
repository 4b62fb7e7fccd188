"""Re-solved outputs beside the recorded ones, number by number, stamp by stamp."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.resolving.rows import (
    Content,
    Key,
    Quantity,
    Row,
    RowReader,
    key_of,
    quantities,
    same_bits,
)
from layered_cbf_ros.bags.storage.topic import Record

REMEMBERED = 4096  # recorded contents by which a repetition is known


@dataclass
class Deviation:
    """How far one quantity of a topic is off where it isn't the same to the bit.

    Attributes:
        count: Numbers that aren't the same to the bit.
        absolute, squared: Sums of |d| and d^2.
        largest: Largest |d|; infinite where only one of the two is a number.
        name, stamp_ns: Where the largest is, None before the first.
    """

    count: int = 0
    absolute: float = 0.0
    squared: float = 0.0
    largest: float = 0.0
    name: str = ''
    stamp_ns: int | None = None

    def add(self, differences: NDArray[np.float64], names: list[str], stamp_ns: int) -> None:
        """Take the numbers that differ at a stamp.

        Args:
            differences: Their |d|, (k,).
            names: What each belongs to, (k,).
            stamp_ns: The stamp [ns].
        """
        self.count += len(differences)
        self.absolute += float(differences.sum())
        self.squared += float(differences @ differences)
        worst = int(differences.argmax())
        if self.stamp_ns is None or differences[worst] > self.largest:
            self.largest = float(differences[worst])
            self.name, self.stamp_ns = names[worst], stamp_ns


@dataclass
class Comparison:
    """The recorded and the re-solved messages of one topic.

    Attributes:
        topic: Its name.
        compared, bit_equal: Stamps at which both are there, and those that are the same.
        repeated: Recorded contents that were sent again.
        other_names: Stamps at which the two don't name the same things.
        first_different_ns: First stamp with a difference [ns].
        span_ns: First and last stamp that was compared [ns].
        deviations: By quantity.
    """

    topic: str
    compared: int = 0
    bit_equal: int = 0
    repeated: int = 0
    other_names: int = 0
    first_different_ns: int | None = None
    span_ns: tuple[int, int] | None = None
    deviations: dict[Quantity, Deviation] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin with nothing that waits for its partner."""
        self._reader = RowReader(self.topic)
        self._recorded: dict[Key, Content] = {}
        self._resolved: dict[Key, Content] = {}
        self._seen: set[Key] = set()
        self._order: deque[Key] = deque()
        self._names: tuple[str, ...] = ()
        self._columns: dict[Quantity, NDArray[np.intp]] = {}

    @property
    def recorded_only(self) -> list[int]:
        """Return the stamps that were recorded but not re-solved [ns]."""
        return sorted(stamp for stamp, _ in self._recorded)

    @property
    def resolved_only(self) -> list[int]:
        """Return the stamps that were re-solved but not recorded [ns]."""
        return sorted(stamp for stamp, _ in self._resolved)

    @property
    def unpaired_within(self) -> int:
        """Return how many contents lack their partner between the first and last pair."""
        if self.span_ns is None:
            return 0
        first, last = self.span_ns
        return sum(first < s < last for s in (*self.recorded_only, *self.resolved_only))

    @property
    def is_equal(self) -> bool:
        """Tell whether all that can be compared is the same, and nothing is missing between."""
        return self.compared == self.bit_equal and not self.unpaired_within

    def mean_and_rms(self, quantity: Quantity) -> tuple[float, float]:
        """Return mean |d| and root mean d^2 of a quantity over all that was compared."""
        deviation = self.deviations.get(quantity, Deviation())
        numbers = max(1, self.compared * len(self._columns.get(quantity, ())))
        return deviation.absolute / numbers, math.sqrt(deviation.squared / numbers)

    def take_recorded(self, record: Record) -> None:
        """Take a recorded message; senders repeat one that they believe lost.

        Raises:
            BagError, MessageError: If it is malformed.
        """
        for content in self._reader.read(record):
            key = key_of(content)
            if key in self._seen:
                self.repeated += 1
                continue
            self._seen.add(key)
            self._order.append(key)
            if len(self._order) > REMEMBERED:
                self._seen.discard(self._order.popleft())
            partner = self._resolved.pop(key, None)
            if partner is None:
                self._recorded[key] = content
            else:
                self._compare(content, partner)

    def take_resolved(self, content: Content) -> None:
        """Take what a core has answered."""
        key = key_of(content)
        partner = self._recorded.pop(key, None)
        if partner is None:
            self._resolved[key] = content
        else:
            self._compare(partner, content)

    def _compare(self, recorded: Content, resolved: Content) -> None:
        """Compare doubles and names; padding and the order of sending don't count."""
        self.compared += 1
        stamp_ns, _ = key_of(recorded)
        first, last = self.span_ns or (stamp_ns, stamp_ns)
        self.span_ns = min(first, stamp_ns), max(last, stamp_ns)
        if isinstance(recorded, bytes) and recorded == resolved:
            self.bit_equal += 1
            return
        old, new = self._reader.row(recorded), self._reader.row(resolved)
        if old.names != new.names:
            self.other_names += 1
            same = False
        else:
            same = self._compare_values(old, new)
        self.bit_equal += same
        if not same and (self.first_different_ns is None or stamp_ns < self.first_different_ns):
            self.first_different_ns = stamp_ns

    def _compare_values(self, old: Row, new: Row) -> bool:
        """Compare two rows of the same names; tell whether they are the same to the bit."""
        differs = ~same_bits(old.values, new.values)
        if not differs.any():
            return True
        if old.names != self._names:
            self._learn(old.names)
        with np.errstate(invalid='ignore'):
            distance = np.abs(new.values - old.values).ravel()
        distance[np.isnan(distance)] = np.inf
        flat = differs.ravel()
        for quantity, columns in self._columns.items():
            chosen = columns[flat[columns]]
            if len(chosen):
                names = [old.names[column % len(old.names)] for column in chosen]
                deviation = self.deviations.setdefault(quantity, Deviation())
                deviation.add(distance[chosen], names, old.stamp_ns)
        return False

    def _learn(self, names: tuple[str, ...]) -> None:
        """Note where each quantity stands in a row of these names."""
        self._names = names
        found = quantities(self.topic, names)
        self._columns = {
            quantity: np.array([k for k, other in enumerate(found) if other == quantity])
            for quantity in dict.fromkeys(found)
        }
