"""One operator at a time: which page steers, what it sends on, and when it counts as gone.

Every open page may ask; who touches the stick first owns the control until he lets go and
a moment longer. An emergency stop goes through whoever owns it. Time is an argument [s].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from layered_cbf_ros.operation.virtual_pad import PadState

SILENCE_S = 0.15
"""An owner who is silent for longer counts as dead [s]."""

GRACE_S = 0.5
"""So long the control stays with who let go, or died [s]."""

REPEATS = 5
"""A stop, or the end of steering, is sent so often: one message may get lost."""


@dataclass(frozen=True, slots=True)
class Lock:
    """Who has the control, and what is still to be said.

    Attributes:
        owner: The page that has it, '' if it is free.
        holds: Whether the owner has something in hand: the stick, the reset, a choice.
        heard_at: When the owner was heard last [s].
        until: When the control becomes free if the owner takes nothing in hand [s].
        barred: The page that held the stick at an emergency stop: it has to let go first.
        stops: How many stops are still to be sent.
        releases: How many released messages are still to be sent.
    """

    owner: str = ''
    holds: bool = False
    heard_at: float = 0.0
    until: float = 0.0
    barred: str = ''
    stops: int = 0
    releases: int = 0

    def is_free_for(self, page: str, now: float) -> bool:
        """Tell whether a page may take the control."""
        return self.owner in ('', page) or now >= self.until

    def seen_by(self, page: str, now: float) -> str:
        """Say who has the control, as a page sees it: 'yours', 'free' or 'other'."""
        if self.is_free_for('', now):
            return 'free'
        return 'yours' if self.owner == page else 'other'


def takes_in_hand(pad: PadState) -> bool:
    """Tell whether a page asks for anything but a stop."""
    chooses = pad.select_all or pad.formation or pad.release or pad.robot is not None
    return pad.enable or pad.reset or chooses


def heard(lock: Lock, page: str, pad: PadState, now: float) -> tuple[Lock, PadState | None, bool]:
    """Take what a page says.

    Args:
        lock: As it is.
        page: Which page.
        pad: What is held on it.
        now: When it came [s].

    Returns:
        The lock, what is to be sent at once, and whether the page was refused.
    """
    if pad.e_stop:
        return stopped(lock), None, False
    if page == lock.barred:
        if pad.enable:
            return lock, None, True
        lock = replace(lock, barred='')
    if not takes_in_hand(pad):
        if page == lock.owner and lock.holds:
            return _let_go(lock, now), PadState(), False
        return lock, None, False
    if not lock.is_free_for(page, now):
        return lock, None, True
    free_at = now + SILENCE_S + GRACE_S
    owned = replace(lock, owner=page, holds=True, heard_at=now, until=free_at, releases=0)
    return owned, None if lock.stops else pad, False


def stopped(lock: Lock) -> Lock:
    """Take an emergency stop; whoever steers has to take the stick anew."""
    barred = lock.owner if lock.holds else lock.barred
    return replace(lock, holds=False, barred=barred, stops=REPEATS, releases=REPEATS)


def passed(lock: Lock, now: float) -> tuple[Lock, PadState | None]:
    """Let time pass, about thirty times a second; return what is to be sent now."""
    if lock.holds and now - lock.heard_at > SILENCE_S:
        lock = _let_go(lock, now)
    if lock.stops:
        return replace(lock, stops=lock.stops - 1), PadState(e_stop=True)
    if lock.releases:
        return replace(lock, releases=lock.releases - 1), PadState()
    return lock, None


def left(lock: Lock, page: str, now: float) -> Lock:
    """Take note that a page is gone: what it held is let go, and the control is free."""
    lock = replace(lock, barred='' if page == lock.barred else lock.barred)
    if page != lock.owner:
        return lock
    return replace(_let_go(lock, now) if lock.holds else lock, owner='', until=now)


def _let_go(lock: Lock, now: float) -> Lock:
    return replace(lock, holds=False, until=now + GRACE_S, releases=REPEATS)
