"""The terminal while a bag is played: keys without Enter, and as it was before at the end."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from types import TracebackType
from typing import TextIO

from layered_cbf_ros.bags.playback.keys import Key, KeyDecoder

MANY = 64


def is_controllable(stream: TextIO = sys.stdin) -> bool:
    """Tell whether keys can be read: a terminal, and this process in its foreground."""
    try:
        return os.isatty(stream.fileno()) and os.tcgetpgrp(stream.fileno()) == os.getpgrp()
    except (OSError, ValueError):  # closed, or no file
        return False


class Keyboard:
    """Reads keys as they are pressed, while it is entered as a context.

    Ctrl-C stays a signal. Whatever way the context is left, the terminal is as before.
    """

    def __init__(self, stream: TextIO = sys.stdin) -> None:
        self._fd = stream.fileno()
        self._decoder = KeyDecoder()
        self._before: list[object] = []

    def __enter__(self) -> Keyboard:
        self._before = termios.tcgetattr(self._fd)
        self.take_over()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)  # type: ignore[arg-type]

    def take_over(self) -> None:
        """Have keys without Enter; again too, after the process was stopped and continued."""
        tty.setcbreak(self._fd, termios.TCSANOW)

    def pressed(self) -> list[Key]:
        """Return the keys pressed since the last call; don't wait for any."""
        if not select.select([self._fd], [], [], 0.0)[0]:
            return []
        try:
            return self._decoder.feed(os.read(self._fd, MANY))
        except OSError:  # the terminal is gone
            return [Key.QUIT]
