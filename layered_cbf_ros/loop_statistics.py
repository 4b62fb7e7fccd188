"""What a node counts about itself, and tells on /diagnostics."""

from __future__ import annotations

import numpy as np

KEPT = 4096  # durations that the percentiles are taken over


class LoopStatistics:
    """Counters of one node; every figure is since the start, but rate and percentiles."""

    def __init__(self) -> None:
        self.ticks = 0
        self.deadline_misses = 0
        self.solver_failures = 0
        self.slack_events = 0
        self.rejected = 0
        self.last_rejected = ''
        self.waiting_for = ''
        self.details: dict[str, str] = {}  # what only this kind of node has to tell
        self._solve_ns = np.zeros(KEPT, dtype=np.int64)
        self._solve_max_ns = 0
        self._reported_ticks = 0
        self._reported_ns = 0

    def tick(self, solve_ns: int) -> None:
        """Count one tick that took this long to compute [ns]."""
        self._solve_ns[self.ticks % KEPT] = solve_ns
        self._solve_max_ns = max(self._solve_max_ns, solve_ns)
        self.ticks += 1

    def reject(self, reason: str) -> None:
        """Count one message that was refused, and remember why."""
        self.rejected += 1
        self.last_rejected = reason

    def report(self, now_ns: int) -> dict[str, str]:
        """Return all figures as the key-values of a diagnostic status.

        Args:
            now_ns: Monotonic wall time [ns]; the rate is since the last report.
        """
        elapsed = max(1, now_ns - self._reported_ns) * 1e-9
        rate = (self.ticks - self._reported_ticks) / elapsed if self._reported_ns else 0.0
        self._reported_ticks, self._reported_ns = self.ticks, now_ns
        times = self._solve_ns[: min(self.ticks, KEPT)] / 1e3
        p50, p99 = np.percentile(times, (50, 99)) if len(times) else (0.0, 0.0)
        return {
            'rate_hz': f'{rate:.1f}',
            'ticks': str(self.ticks),
            'deadline_misses': str(self.deadline_misses),
            'solver_failures': str(self.solver_failures),
            'slack_events': str(self.slack_events),
            'rejected': str(self.rejected),
            'last_rejected': self.last_rejected,
            'waiting_for': self.waiting_for,
            'solve_time_p50_us': f'{p50:.0f}',
            'solve_time_p99_us': f'{p99:.0f}',
            'solve_time_max_us': f'{self._solve_max_ns / 1e3:.0f}',
            **self.details,
        }
