"""What a node counts about itself, and tells on /diagnostics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.health import (
    COUNTERS,
    Counts,
    Fault,
    Level,
    Remembered,
    Situation,
    faults_of,
    remember,
    verdict,
)
from layered_cbf_ros.interfaces import NS_PER_S

KEPT = 4096  # durations that the percentiles are taken over
INTERRUPTION_NS = NS_PER_S  # a longer interval is a pause or a wait, and told as that


class Ring:
    """The last few thousand durations, in memory that is taken once."""

    def __init__(self) -> None:
        self._values = np.zeros(KEPT, dtype=np.int64)
        self._count = 0

    def add(self, duration_ns: int) -> None:
        """Keep one more [ns]; the oldest goes."""
        self._values[self._count % KEPT] = duration_ns
        self._count += 1

    @property
    def values(self) -> NDArray[np.int64]:
        """Return what is kept [ns], in no order."""
        return self._values[: min(self._count, KEPT)]


def percentiles(values: NDArray[np.int64], shares: Sequence[float]) -> list[int]:
    """Return the values of the nearest ranks; zeros if there is none.

    They are not sorted for it: that would take several times as long, between two ticks.
    With the middle among what is asked for, numpy finds a rank near the end sooner.
    """
    if not len(values):
        return [0] * len(shares)
    ranks = [round(share * (len(values) - 1)) for share in shares]
    return [int(value) for value in np.partition(values, [len(values) // 2, *ranks])[ranks]]


class LoopStatistics:
    """Counters of one node since its start, and what is wrong with it.

    Attributes:
        state: 'starting', 'running', 'paused' or 'ended'.
        real_time: Whether ticks have deadlines.
        period_ns: Time between two ticks, as it should be [ns]; 0 if there is none.
        details: What only this kind of node has to tell.
        faults: What is wrong now that only this kind of node knows.
    """

    def __init__(self) -> None:
        self.state = 'starting'
        self.real_time = False
        self.period_ns = 0
        self.ticks = 0
        self.deadline_misses = 0
        self.solver_failures = 0
        self.slack_events = 0
        self.without_input = 0
        self.rejected = 0
        self.lost = 0
        self.last_missing = ''
        self.last_rejected = ''
        self.waiting_for = ''
        self.details: dict[str, str] = {}
        self.faults: tuple[Fault, ...] = ()
        self._idle = False
        self._waiting_since_ns = 0
        self._solve, self._intervals = Ring(), Ring()
        self._solve_max_ns = self._jitter_max_ns = 0
        self._begun_ns = 0
        self._stamp_ns: int | None = None
        self._reported = Counts()
        self._reported_ns = 0
        self._reported_stamp_ns: int | None = None
        self._remembered: tuple[Remembered, ...] = ()

    def begin(self, now_ns: int, stamp_ns: int | None = None) -> None:
        """Note that a tick begins.

        Args:
            now_ns: Monotonic wall time [ns].
            stamp_ns: Stamp of the state it is for [ns], None if that is not known.
        """
        interval_ns = now_ns - self._begun_ns
        if interval_ns < INTERRUPTION_NS:
            self._intervals.add(interval_ns)
        self._begun_ns = now_ns
        self._stamp_ns = stamp_ns
        self.waiting_for = ''

    def tick(self, solve_ns: int, count: int = 1) -> None:
        """Count a tick, or several at once, that took this long to compute [ns]."""
        self._solve.add(solve_ns)
        self._solve_max_ns = max(self._solve_max_ns, solve_ns)
        self.ticks += count

    def reject(self, reason: str) -> None:
        """Count one message that was refused, and remember why."""
        self.rejected += 1
        self.last_rejected = reason

    def miss_input(self, sender: str) -> None:
        """Count one tick that has to do without an input."""
        self.without_input += 1
        self.last_missing = sender

    def wait_for(self, whom: str, now_ns: int, idle: bool = False) -> None:
        """Note that the node waits, until its next tick begins.

        Args:
            whom: Whom or what it waits for.
            now_ns: Monotonic wall time [ns].
            idle: Whether that is its next tick, and not what a tick needs.
        """
        if not self.waiting_for:
            self._waiting_since_ns = now_ns
        self.waiting_for, self._idle = whom, idle

    def report(self, now_ns: int) -> tuple[Level, str, dict[str, str]]:
        """Return the level, what a person should know, and all figures.

        Args:
            now_ns: Monotonic wall time [ns]; news are since the last report.
        """
        counts = Counts(*(getattr(self, name) for name in COUNTERS))
        news = counts.since(self._reported)
        elapsed_ns = now_ns - self._reported_ns if self._reported_ns else 0
        present = faults_of(news, self._situation(now_ns))
        self._remembered = remember(self._remembered, present, now_ns)
        level, faults = verdict(self._remembered, now_ns)
        values = self._figures(counts, news, elapsed_ns) | {'faults': faults} | self.details
        self._reported, self._reported_ns = counts, now_ns
        self._reported_stamp_ns = self._stamp_ns
        return level, faults or self.state, values

    def _situation(self, now_ns: int) -> Situation:
        return Situation(
            self.real_time,
            self.waiting_for,
            (now_ns - self._waiting_since_ns) / NS_PER_S if self.waiting_for else 0.0,
            self._idle,
            self.last_rejected,
            self.last_missing,
            self.details,
            self.faults,
        )

    def _figures(self, counts: Counts, news: Counts, elapsed_ns: int) -> dict[str, str]:
        elapsed = max(1, elapsed_ns) / NS_PER_S
        rate = news.ticks / elapsed if elapsed_ns else 0.0
        p50, p99 = percentiles(self._solve.values, (0.5, 0.99))
        nominal_ns, jitter_ns = self._jitter()
        return {
            'state': self.state,
            'stamp_s': '' if self._stamp_ns is None else f'{self._stamp_ns / NS_PER_S:.3f}',
            'real_time_factor': self._factor(elapsed_ns),
            'rate_hz': f'{rate:.1f}',
            **{name: str(getattr(counts, name)) for name in COUNTERS},
            'last_missing': self.last_missing,
            'last_rejected': self.last_rejected,
            'waiting_for': self.waiting_for,
            'jitter_from': 'period' if self._has_period else 'median',
            'jitter_nominal_us': f'{nominal_ns / 1e3:.0f}',
            'jitter_p99_us': f'{jitter_ns / 1e3:.0f}',
            'jitter_max_us': f'{self._jitter_max_ns / 1e3:.0f}',
            'solve_time_p50_us': f'{p50 / 1e3:.0f}',
            'solve_time_p99_us': f'{p99 / 1e3:.0f}',
            'solve_time_max_us': f'{self._solve_max_ns / 1e3:.0f}',
        }

    def _jitter(self) -> tuple[int, int]:
        """Return the nominal interval and the 99th percentile of the deviations from it [ns].

        An interval is the wall time between the beginnings of two ticks. In real time it
        should be the period. In lockstep a tick begins when everybody is done: there the
        median of the last intervals stands for the period.
        """
        intervals = self._intervals.values
        if not len(intervals):
            return 0, 0
        nominal_ns = self.period_ns if self._has_period else percentiles(intervals, (0.5,))[0]
        deviations = np.abs(intervals - nominal_ns)
        self._jitter_max_ns = max(self._jitter_max_ns, int(deviations.max()))
        return nominal_ns, percentiles(deviations, (0.99,))[0]

    @property
    def _has_period(self) -> bool:
        return self.real_time and bool(self.period_ns)

    def _factor(self, elapsed_ns: int) -> str:
        """Return how fast the stamps went on since the last report, '' if that is not known."""
        if self._stamp_ns is None or self._reported_stamp_ns is None or not elapsed_ns:
            return ''
        return f'{(self._stamp_ns - self._reported_stamp_ns) / elapsed_ns:.2f}'
