"""The clock of a run in real time: wall time, or a slower time that begins at 0.

Real robots live in wall time. An emulated one can live in a slower time, on a machine
that is too slow for the real one; everything then goes by that time, and only by it.
"""

from __future__ import annotations

import time

from layered_cbf_ros.timing import TimingParameters


class RunClock:
    """Tells the run's time, and sleeps until one.

    It never jumps: only its beginning is taken from the wall clock, the rest from the
    monotonic one. The clocks of all processes of a machine agree to the microsecond.
    """

    def __init__(self, timing: TimingParameters) -> None:
        self._pace = timing.pace
        self._origin_ns = timing.epoch_ns - (time.time_ns() - time.monotonic_ns())

    def now_ns(self) -> int:
        """Return the run's time: since its epoch, which is that of the wall clock or its own."""
        return round((time.monotonic_ns() - self._origin_ns) * self._pace)

    def monotonic_ns(self, stamp_ns: int) -> int:
        """Return when, by the monotonic clock, a time of the run is [ns]."""
        return round(stamp_ns / self._pace) + self._origin_ns

    def sleep_until(self, stamp_ns: int) -> None:
        """Sleep until a time of the run; not at all if it is over."""
        left_ns = self.monotonic_ns(stamp_ns) - time.monotonic_ns()
        if left_ns > 0:
            time.sleep(left_ns * 1e-9)
