"""How late messages were sent, counted without keeping every one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

LATE_NS = 1_000_000
US, MS = 1_000, 1_000_000
STEPS = 4  # bits: each bin is at most a sixteenth of its error wide


class TimingErrors:
    """Delays of messages behind their deadlines: mean, percentiles, greatest.

    An endless replay needs no more memory than a short one, so percentiles come from
    bins: they are told up to 1/16 too large, never too small.

    Attributes:
        count: Messages.
        late: Of these, those sent more than 1 ms late.
        max_ns: Greatest delay [ns].
    """

    def __init__(self) -> None:
        self.count = self.late = self.max_ns = 0
        self._sum_ns = 0
        self._bins: Counter[int] = Counter()

    def add(self, error_ns: int) -> None:
        """Count the delay of one message [ns]."""
        self.count += 1
        self._sum_ns += error_ns
        if error_ns > LATE_NS:
            self.late += 1
        if error_ns > self.max_ns:
            self.max_ns = error_ns
        shift = max(0, error_ns.bit_length() - STEPS - 1)
        self._bins[((error_ns >> shift) + 1) << shift] += 1

    @property
    def mean_ns(self) -> float:
        """Return the mean delay [ns]."""
        return self._sum_ns / self.count if self.count else 0.0

    def percentile_ns(self, share: float) -> int:
        """Return the delay that a share (0 to 1) of the messages did not exceed [ns]."""
        reached = 0
        for end_ns, count in sorted(self._bins.items()):
            reached += count
            if reached >= share * self.count:
                return min(end_ns, self.max_ns)
        return self.max_ns

    def lines(self) -> Iterator[str]:
        """Yield the figures as text."""
        if not self.count:
            yield 'timing error: no message was sent by the clock'
            return
        p50, p99 = self.percentile_ns(0.5), self.percentile_ns(0.99)
        yield (
            f'timing error: mean {self.mean_ns / MS:.3f} ms, p50 {p50 / MS:.3f} ms, '
            f'p99 {p99 / MS:.3f} ms, max {self.max_ns / MS:.3f} ms'
        )
        yield f'{self.late} of {self.count} messages were late by more than 1 ms'
