"""Frames at an even pace, as far as the machine has time for them."""

from __future__ import annotations

import time

FRAMES_A_SECOND = 30.0


class Pace:
    """Waits until the next frame is due; one that was missed isn't made up for."""

    def __init__(self, rate: float = FRAMES_A_SECOND) -> None:
        """Begin.

        Args:
            rate: Frames a second [Hz].
        """
        self._period = 1.0 / rate
        self._due = self._last = time.monotonic()

    def wait(self) -> float:
        """Wait for the next frame; return the wall time since the one before [s]."""
        now = time.monotonic()
        self._due = max(self._due + self._period, now)
        if self._due > now:
            time.sleep(self._due - now)
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        return elapsed
