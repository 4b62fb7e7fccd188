"""How the stamps of a topic run on: how fast, with which gaps, and whether they jump back."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

RECENT = 32
RESENT_NS = 500_000_000
"""A stamp that was among the last few, and is no older than this [ns], was sent again."""

YEAR_NS = 365 * 86_400 * 10**9


@dataclass(frozen=True, slots=True)
class StampJump:
    """The first time that stamps fell back.

    Attributes:
        from_ns, to_ns: Newest stamp before, and the one that follows [ns].
        log_time_ns: When that was recorded [ns].
    """

    from_ns: int
    to_ns: int
    log_time_ns: int


class StampTrack:
    """Follows the stamps of one topic.

    Attributes:
        count: Messages with a stamp.
        span_ns: Time that they cover, what lies before a jump included [ns].
        longest_gap_ns: Longest time between a stamp and the next newer one [ns].
        gap_from_ns: The stamp before it [ns].
        jumps: How often they fell back.
        first_jump: The first time, None if they never did.
    """

    def __init__(self, tolerance_ns: int) -> None:
        """Begin.

        Args:
            tolerance_ns: A stamp that is older than the newest by no more than this is
                no jump: several senders of one topic are never quite in step [ns].
        """
        self.count = 0
        self.span_ns = 0
        self.longest_gap_ns = 0
        self.gap_from_ns = 0
        self.jumps = 0
        self.first_jump: StampJump | None = None
        self._tolerance_ns = tolerance_ns
        self._newest_ns: int | None = None
        self._recent: deque[int] = deque(maxlen=RECENT)

    def take(self, stamp_ns: int, log_time_ns: int) -> None:
        """Take the stamp of the next message, and when it was recorded [ns]."""
        newest_ns = self._newest_ns
        self.count += 1
        if newest_ns is None or (newest_ns == 0 and stamp_ns > YEAR_NS):
            pass  # the first; or the first that was set at all
        elif stamp_ns > newest_ns:
            gap_ns = stamp_ns - newest_ns
            self.span_ns += gap_ns
            if gap_ns > self.longest_gap_ns:
                self.longest_gap_ns, self.gap_from_ns = gap_ns, newest_ns
        elif self._is_jump(newest_ns, stamp_ns):
            self.jumps += 1
            self.first_jump = self.first_jump or StampJump(newest_ns, stamp_ns, log_time_ns)
            self._recent.clear()
        else:
            return
        self._newest_ns = stamp_ns
        self._recent.append(stamp_ns)

    @property
    def rate(self) -> float | None:
        """Messages per second of their stamps [Hz]; None if that has no meaning."""
        if not self.span_ns:
            return None
        return 1e9 * (self.count - 1 - self.jumps) / self.span_ns

    def _is_jump(self, newest_ns: int, stamp_ns: int) -> bool:
        """Tell whether a stamp that isn't newer belongs to another course of time."""
        back_ns = newest_ns - stamp_ns
        if not stamp_ns or back_ns <= self._tolerance_ns:  # zero: it was never set
            return False
        return back_ns > RESENT_NS or stamp_ns not in self._recent
