"""When each message of a bag is due: its log time, put on the monotonic clock."""

from __future__ import annotations


class Schedule:
    """Maps bag time to absolute deadlines, which errors of single messages don't shift.

    Bag time runs at `rate` times the monotonic clock; it stands still while paused.
    """

    def __init__(self, bag_ns: int, now_ns: int, rate: float = 1.0, paused: bool = False) -> None:
        """Begin.

        Args:
            bag_ns: Bag time to begin at [ns].
            now_ns: Monotonic clock [ns].
            rate: Seconds of bag time in one second.
            paused: Whether bag time stands still at first.
        """
        self.rate = rate
        self.paused = paused
        self._bag_ns = bag_ns
        self._wall_ns = now_ns

    def due_ns(self, log_ns: int) -> int:
        """Return when a message of this log time is to be sent, on the monotonic clock [ns]."""
        return self._wall_ns + round((log_ns - self._bag_ns) / self.rate)

    def bag_time_ns(self, now_ns: int) -> int:
        """Return the bag time at a time of the monotonic clock [ns]."""
        if self.paused:
            return self._bag_ns
        return self._bag_ns + round((now_ns - self._wall_ns) * self.rate)

    def restart(self, bag_ns: int, now_ns: int) -> None:
        """Go to a bag time, at the rate and in the state (running or paused) of before."""
        self._bag_ns, self._wall_ns = bag_ns, now_ns

    def toggle_pause(self, now_ns: int) -> None:
        """Let bag time stand still, or run on from where it stood."""
        self.restart(self.bag_time_ns(now_ns), now_ns)
        self.paused = not self.paused

    def set_rate(self, rate: float, now_ns: int) -> None:
        """Change the rate from now on."""
        self.restart(self.bag_time_ns(now_ns), now_ns)
        self.rate = rate

    def step_to(self, log_ns: int) -> None:
        """Bring bag time forward to a message that was sent while paused."""
        self._bag_ns = max(self._bag_ns, log_ns)

    def shift(self, held_ns: int) -> None:
        """Put off all that is to come: bag time stood still for so long [ns]."""
        self._wall_ns += held_ns
