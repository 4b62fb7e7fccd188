"""Sends the messages of a bag, each when it is due, and does small chores in between."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from layered_cbf_ros.bags.playback.keys import Key
from layered_cbf_ros.bags.playback.schedule import Schedule
from layered_cbf_ros.bags.playback.timing_errors import TimingErrors
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.interfaces import NS_PER_S

REST_NS = 20_000_000  # longest time without a look at the keys
HOLD_NS = 200_000  # between two looks whether a node has caught up
RATE_STEP = 0.1


@dataclass
class Chore:
    """Something to be done again and again while a bag is played.

    Attributes:
        period_ns: How often [ns]; turns that were missed are left out.
        act: Does it, given the monotonic clock [ns].
        next_ns: When next, on the monotonic clock [ns].
    """

    period_ns: int
    act: Callable[[int], None]
    next_ns: int = 0

    def do_if_due(self, now_ns: int) -> None:
        """Do it, if it is time to."""
        if now_ns < self.next_ns:
            return
        missed = (now_ns - self.next_ns) // self.period_ns
        self.next_ns = (
            self.next_ns + (missed + 1) * self.period_ns
            if self.next_ns
            else now_ns + self.period_ns
        )
        self.act(now_ns)


@dataclass(frozen=True)
class Clock:
    """The monotonic clock, or what stands for it in a test.

    Attributes:
        now_ns: Returns the time [ns].
        sleep: Waits for a time [s].
    """

    now_ns: Callable[[], int]
    sleep: Callable[[float], None]


class Player:
    """Plays records on a schedule; keys and signals take effect within 20 ms.

    Attributes:
        schedule: When what is due.
        errors: Delays of all messages but those sent by hand while paused.
        sent: Messages sent.
        held_ns: For how long the replay was held back by a node that it feeds [ns].
        stopped: Set to end the replay, from a signal handler too.
    """

    def __init__(
        self,
        schedule: Schedule,
        publish: Callable[[Record], None],
        clock: Clock,
        may_send: Callable[[Record, int], bool] | None = None,
    ) -> None:
        """Choose what is done with each message.

        Args:
            schedule: When what is due.
            publish: Sends one.
            clock: What time it is.
            may_send: Tells, given the monotonic clock [ns], whether a message that is due
                may be sent yet; None if all may.
        """
        self.schedule = schedule
        self.errors = TimingErrors()
        self.chores: list[Chore] = []
        self.sent = self.held_ns = 0
        self.stopped = False
        self._publish = publish
        self._clock = clock
        self._may_send = may_send
        self._next_chore_ns = 0
        self._steps = 0

    def play(self, records: Iterable[Record]) -> None:
        """Send records, in their order, until they end or the replay is stopped."""
        for record in records:
            if not self._wait_for(record):
                return
            self._publish(record)
            self.sent += 1

    def rest(self, duration_ns: int) -> None:
        """Do nothing but chores for a while [ns]; bag time stands still."""
        now_ns = self._clock.now_ns()
        end_ns = now_ns + duration_ns
        while not self.stopped and now_ns < end_ns:
            self._do_chores(now_ns)
            self._sleep(min(end_ns, self._next_chore_ns) - now_ns)
            before_ns, now_ns = now_ns, self._clock.now_ns()
            self.schedule.shift(now_ns - before_ns)

    def press(self, key: Key) -> None:
        """Do what a key asks for."""
        now_ns, schedule = self._clock.now_ns(), self.schedule
        if key is Key.PAUSE:
            schedule.toggle_pause(now_ns)
            self._steps = 0
        elif key is Key.STEP and schedule.paused:
            self._steps += 1
        elif key is Key.FASTER:
            schedule.set_rate(schedule.rate * (1.0 + RATE_STEP), now_ns)
        elif key is Key.SLOWER:
            schedule.set_rate(schedule.rate * (1.0 - RATE_STEP), now_ns)
        elif key is Key.QUIT:
            self.stopped = True

    def _wait_for(self, record: Record) -> bool:
        """Wait until a message is to be sent; return False if it never is."""
        while True:
            now_ns = self._clock.now_ns()
            if now_ns >= self._next_chore_ns:
                self._do_chores(now_ns)
            if self.stopped:
                return False
            by_hand = self.schedule.paused
            due_ns = now_ns if by_hand else self.schedule.due_ns(record.log_time_ns)
            if (by_hand and not self._steps) or now_ns < due_ns:
                until_ns = self._next_chore_ns if by_hand else min(due_ns, self._next_chore_ns)
                self._sleep(until_ns - now_ns)
                continue
            if self._may_send is not None and not self._may_send(record, now_ns):
                self._hold(now_ns)
                continue
            if by_hand:
                self._steps -= 1
                self.schedule.step_to(record.log_time_ns)
            else:
                self.errors.add(now_ns - due_ns)
            return True

    def _hold(self, now_ns: int) -> None:
        """Let a moment pass that doesn't count."""
        self._sleep(HOLD_NS)
        held_ns = self._clock.now_ns() - now_ns
        self.held_ns += held_ns
        self.schedule.shift(held_ns)

    def _do_chores(self, now_ns: int) -> None:
        for chore in self.chores:
            chore.do_if_due(now_ns)
        self._next_chore_ns = min([now_ns + REST_NS, *(chore.next_ns for chore in self.chores)])

    def _sleep(self, duration_ns: int) -> None:
        if duration_ns > 0:
            self._clock.sleep(duration_ns / NS_PER_S)
