"""Signals that end a process, and how a node ends in order by any of them."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType

UNCATCHABLE = {signal.SIGKILL, signal.SIGSTOP}
HARMLESS = {signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH}
CRASHES = {signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT}
"""Raised by broken code: to go on after them is no way to an orderly end."""

Handler = Callable[[int, FrameType | None], None]


def call_on_any(handler: Handler) -> None:
    """Call a function on every signal that would end or stop this process.

    That includes a terminal's Ctrl-Z: a driver that is stopped lets its robot down unseen.
    """
    for number in signal.valid_signals() - UNCATCHABLE - HARMLESS - CRASHES:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
