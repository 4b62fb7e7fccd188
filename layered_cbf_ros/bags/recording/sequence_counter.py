"""Counts lost messages by the numbers that publishers give them: exact, whatever is sent."""

from __future__ import annotations

from collections.abc import Callable

UNKNOWN = (1 << 64) - 1
"""What a middleware that doesn't number messages gives instead."""


class SequenceCounter:
    """Counts the messages of one topic.

    Each publisher numbers its messages 1, 2, 3, ...; but a message doesn't tell which
    publisher it is from. So a number continues the stream that waits for just this one;
    else, if there are publishers yet unheard, it begins a stream; else it continues the
    stream that waited for the nearest lower number, and all between are lost.

    Attributes:
        lost: Messages lost since their publisher's first one.
        missed_before: Messages sent before the first of their publisher that was received.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        """Begin to count.

        Args:
            publishers: Tells how many publishers are matched; asked only in doubt.
        """
        self.lost = 0
        self.missed_before = 0
        self._publishers = publishers
        self._expected: list[int] = []  # next number of each stream, the last heard last

    def receive(self, number: int) -> None:
        """Count one message. Runs for every message there is."""
        expected = self._expected
        if expected and expected[-1] == number:
            expected[-1] = number + 1
        elif number in expected:
            expected.remove(number)
            expected.append(number + 1)
        elif number != UNKNOWN:
            self._receive_unexpected(number)

    def _receive_unexpected(self, number: int) -> None:
        publishers = self._publishers()
        lower = [waited for waited in self._expected if waited < number]
        if not lower or len(self._expected) < publishers:
            self.missed_before += number - 1
        else:
            self._expected.remove(max(lower))
            self.lost += number - max(lower)
        self._expected.append(number + 1)
        gone = len(self._expected) - max(1, publishers)
        if gone > 0:  # publishers that have left; those not heard for longest
            del self._expected[:gone]
