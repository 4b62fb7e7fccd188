"""Which recorded inputs made a tick: by stamp in lockstep, by arrival in real time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.timing import InputRule

PATIENCE_NS = NS_PER_S
"""Messages of one moment stand this near to each other in a bag, by their stamps [ns]."""


@dataclass(frozen=True, slots=True)
class Tick:
    """What a node computes on.

    Attributes:
        stamp_ns: Stamp of what it ticks on [ns].
        record: What it ticks on.
        inputs: The other inputs by topic, None where a tick has none.
    """

    stamp_ns: int
    record: Record
    inputs: Mapping[str, Any]


@dataclass
class Shelf:
    """The messages of one topic that may still be needed, by stamp; the first of each counts."""

    contents: dict[int, Any] = field(default_factory=dict)
    first_ns: int | None = None
    newest_ns: int = -1

    def offer(self, stamp_ns: int, content: Any) -> None:
        """Keep a message."""
        self.first_ns = stamp_ns if self.first_ns is None else min(self.first_ns, stamp_ns)
        self.newest_ns = max(self.newest_ns, stamp_ns)
        self.contents.setdefault(stamp_ns, content)

    def forget_before(self, stamp_ns: int) -> None:
        """Forget what is older."""
        for old in [stamp for stamp in self.contents if stamp < stamp_ns]:
            del self.contents[old]


class LockstepTicks:
    """Every tick gets exactly the stamps that the timing rules want, as in the run."""

    def __init__(
        self, node: str, ticking: str, every_ns: int, rules: Mapping[str, InputRule]
    ) -> None:
        """Begin.

        Args:
            node: Whose ticks they are, for a person.
            ticking: The topic it ticks on.
            every_ns: Period of its ticks [ns].
            rules: Of its other inputs, by topic.
        """
        self._node, self._ticking, self._every_ns, self._rules = node, ticking, every_ns, rules
        self._shelves = {topic: Shelf() for topic in (ticking, *rules)}
        self._next_ns: int | None = None
        self._has_begun = self.from_start = False
        self.skipped = 0

    def offer(self, topic: str, stamp_ns: int, content: Any) -> None:
        """Take a message, of the topic it ticks on the record; a repetition changes nothing."""
        if self._next_ns is None and topic == self._ticking:
            self._next_ns = -(-stamp_ns // self._every_ns) * self._every_ns
            self._has_begun = self.from_start = stamp_ns == 0
        self._shelves[topic].offer(stamp_ns, content)

    def due(self) -> Iterator[Tick]:
        """Yield the ticks that have all they need, in order.

        Raises:
            BagError: If one can't have it any more, for later messages have come.
        """
        while self._next_ns is not None:
            now_ns = self._next_ns
            wanted = {topic: rule.wanted(now_ns) for topic, rule in self._rules.items()}
            missing = self._missing({self._ticking: now_ns, **wanted})
            if missing is None:
                yield self._tick(now_ns, wanted)
                self._has_begun = True
            elif not self._has_begun and self._precedes_all(*missing):
                self.skipped += 1
            else:
                self._give_up_on(*missing)
                return
            self._next_ns = now_ns + self._every_ns

    def end(self) -> None:
        """Check that what is missing is missing at the end, not in between."""
        if self._next_ns is None:
            return
        wanted = {topic: rule.wanted(self._next_ns) for topic, rule in self._rules.items()}
        missing = self._missing({self._ticking: self._next_ns, **wanted})
        if missing is not None:
            topic, stamp_ns = missing
            if self._shelves[topic].newest_ns > stamp_ns:
                raise self._hole(topic, stamp_ns)
        ticks = self._shelves[self._ticking].contents
        self.skipped += sum(
            stamp >= self._next_ns and stamp % self._every_ns == 0 for stamp in ticks
        )

    def _missing(self, wanted: Mapping[str, int | None]) -> tuple[str, int] | None:
        """Return topic and stamp of the first message that isn't there, if any."""
        for topic, stamp_ns in wanted.items():
            if stamp_ns is not None and stamp_ns not in self._shelves[topic].contents:
                return topic, stamp_ns
        return None

    def _precedes_all(self, topic: str, stamp_ns: int) -> bool:
        """Tell whether a bag that starts in the middle of a run lacks what came before it."""
        first_ns = self._shelves[topic].first_ns
        return first_ns is not None and stamp_ns < first_ns

    def _give_up_on(self, topic: str, stamp_ns: int) -> None:
        newest_ns = max(shelf.newest_ns for shelf in self._shelves.values())
        if newest_ns > stamp_ns + PATIENCE_NS:
            raise self._hole(topic, stamp_ns)

    def _hole(self, topic: str, stamp_ns: int) -> BagError:
        return BagError(
            f'{topic} lacks stamp {stamp_ns / NS_PER_S:.3f} s: {self._node} acted on it, so '
            'nothing after it can be re-solved; choose another node, or a bag without a hole'
        )

    def _tick(self, now_ns: int, wanted: Mapping[str, int | None]) -> Tick:
        record = self._shelves[self._ticking].contents[now_ns]
        inputs: dict[str, Any] = {}
        for topic, stamp_ns in wanted.items():
            inputs[topic] = None
            if stamp_ns is not None:
                inputs[topic] = self._shelves[topic].contents[stamp_ns]
                self._shelves[topic].forget_before(stamp_ns)
        self._shelves[self._ticking].forget_before(now_ns + 1)
        return Tick(now_ns, record, inputs)


class Gathered(Protocol):
    """An input that is gathered from many messages in real time."""

    def at(self, stamp_ns: int, sent_ns: int) -> Any:
        """Return what had come by a wall time, for a tick of a stamp [ns]."""


class RealTimeTicks:
    """A tick is an output that was recorded; its inputs are the newest it can have had.

    Which message a node had at hand isn't recorded: the newest by stamp is taken that
    had reached the recorder when the output was sent.
    """

    def __init__(
        self, ticking: str, rules: Mapping[str, InputRule], gathered: Mapping[str, Gathered]
    ) -> None:
        """Begin.

        Args:
            ticking, rules: As of LockstepTicks.
            gathered: Inputs that are more than one message, by topic.
        """
        self._ticking, self._rules, self._gathered = ticking, rules, gathered
        self._states = Shelf()
        self._received: dict[str, deque[tuple[int, int, Any]]] = {t: deque() for t in rules}
        self._answers: deque[tuple[int, int]] = deque()
        self._last_ns = -1
        self.skipped = 0

    def offer(self, topic: str, stamp_ns: int, content: Any, log_ns: int) -> None:
        """Take an input, of the topic it ticks on the record."""
        if topic == self._ticking:
            self._states.offer(stamp_ns, content)
            self._states.forget_before(stamp_ns - PATIENCE_NS)
        else:
            self._received[topic].append((log_ns, stamp_ns, content))

    def sent(self, stamp_ns: int, sent_ns: int) -> None:
        """Take note that the node has sent its answer to a stamp, at a wall time [ns]."""
        if stamp_ns > self._last_ns:  # else it was sent again
            self._last_ns = stamp_ns
            self._answers.append((stamp_ns, sent_ns))

    def due(self) -> Iterator[Tick]:
        """Yield the ticks whose answers were sent, and whose states have come."""
        while self._answers and self._answers[0][0] <= self._states.newest_ns:
            stamp_ns, sent_ns = self._answers.popleft()
            found = self._states.contents.get(stamp_ns)
            if found is None:
                self.skipped += 1
                continue
            inputs = {
                topic: self._newest(topic, rule, stamp_ns, sent_ns)
                for topic, rule in self._rules.items()
            }
            inputs |= {topic: it.at(stamp_ns, sent_ns) for topic, it in self._gathered.items()}
            yield Tick(stamp_ns, found, inputs)

    def _newest(self, topic: str, rule: InputRule, stamp_ns: int, sent_ns: int) -> Any:
        """Return the newest input that had come, None if it was too old."""
        received = self._received[topic]
        usable = [
            entry
            for entry in received
            if entry[0] <= sent_ns and entry[1] <= stamp_ns + rule.period_ns
        ]
        if not usable:
            return None
        best = max(usable, key=lambda entry: entry[1])
        while received and received[0][1] < best[1]:
            received.popleft()
        return best[2] if stamp_ns - best[1] <= rule.age_limit_ns else None
