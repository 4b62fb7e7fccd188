"""One pass through a bag that computes every tick of some nodes once more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol, TypeVar

from layered_cbf_ros.bags.resolving.rows import Content
from layered_cbf_ros.bags.resolving.seats import Seat
from layered_cbf_ros.bags.resolving.ticks import Tick
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import BagError, MessageError

T = TypeVar('T')


class Listener(Protocol):
    """Whoever wants to know what was recorded and what was re-solved.

    Attributes:
        topics: Recorded topics that it wants.
    """

    topics: frozenset[str]

    def recorded(self, record: Record) -> None:
        """Take a recorded message of one of its topics."""

    def resolved(self, topic: str, content: Content, tick: Tick) -> None:
        """Take an answer of a core to a tick."""


def resolve(bag: Bag, seats: Sequence[Seat], listeners: Sequence[Listener]) -> None:
    """Compute every tick again, in the order in which its inputs were recorded.

    Args:
        bag: The recording.
        seats: The cores.
        listeners: They are told everything.

    Raises:
        BagError: If an input is missing or malformed, or nothing could be computed.
    """
    _refuse_missing(bag, seats)
    users = _by_topic((topic, seat) for seat in seats for topic in seat.topics)
    curious = _by_topic((topic, it) for it in listeners for topic in it.topics)
    for record in bag.in_time_order({*users, *curious}):
        topic = record.topic.name
        try:
            for listener in curious.get(topic, ()):
                listener.recorded(record)
            for seat in users.get(topic, ()):
                for tick in seat.take(record):
                    _answer(seat, tick, listeners)
        except MessageError as error:
            raise BagError(f'{topic}: {error}') from None
    for seat in seats:
        seat.end()
        if not seat.core.tally.ticks:
            needed = ', '.join(sorted(seat.needed))
            raise BagError(f'{bag.path} holds no whole tick of {seat.core.node}: it needs {needed}')


def _answer(seat: Seat, tick: Tick, listeners: Sequence[Listener]) -> None:
    for topic, content in seat.core.answers(tick):
        for listener in listeners:
            listener.resolved(topic, content, tick)


def _by_topic(pairs: Iterable[tuple[str, T]]) -> dict[str, list[T]]:
    """Return who wants each topic."""
    wanted: dict[str, list[T]] = {}
    for topic, who in pairs:
        wanted.setdefault(topic, []).append(who)
    return wanted


def _refuse_missing(bag: Bag, seats: Sequence[Seat]) -> None:
    for seat in seats:
        for topic in sorted(seat.needed):
            if topic not in bag.topics:
                raise BagError(
                    f'{bag.path} has no {topic}: {seat.core.node} acts on it; record it too, or '
                    'name another node'
                )
