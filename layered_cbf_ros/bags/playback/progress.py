"""How far a replay is, as one line."""

from __future__ import annotations

import shutil
from typing import TextIO

from layered_cbf_ros.interfaces import NS_PER_S

BAR = 30
KEYS = 'space: pause, right: one message, up/down: rate, q: quit'
TERMINAL_PERIOD_NS = NS_PER_S // 10
LOG_PERIOD_NS = 10 * NS_PER_S


class Progress:
    """Keeps one line up to date on a terminal; prints one now and then into a log.

    Attributes:
        period_ns: How often to show it [ns].
    """

    def __init__(self, stream: TextIO, terminal: bool, keys: bool, end_ns: int) -> None:
        """Choose how to print.

        Args:
            stream: Where to.
            terminal: Whether it is a terminal.
            keys: Whether keys are obeyed, to be told which.
            end_ns: Last bag time to be played, since the bag's begin [ns].
        """
        self._stream = stream
        self._terminal = terminal
        self._keys = keys
        self._end_ns = end_ns
        self._shown = False
        self.period_ns = TERMINAL_PERIOD_NS if terminal else LOG_PERIOD_NS

    def show(self, bag_ns: int, rate: float, state: str) -> None:
        """Show where the replay is.

        Args:
            bag_ns: Bag time since the bag's begin [ns].
            rate: Seconds of bag time in one second.
            state: A word on it.
        """
        text = progress_line(bag_ns, self._end_ns, rate, state)
        if not self._terminal:
            print(text, file=self._stream, flush=True)
            return
        if self._keys:
            text += f'  ({KEYS})'
        columns = shutil.get_terminal_size().columns
        self._stream.write(f'\r{text[: columns - 1]}\033[K')
        self._stream.flush()
        self._shown = True

    def end(self) -> None:
        """Leave the line as it is; what follows is printed below it."""
        if self._shown:
            print(file=self._stream, flush=True)
            self._shown = False


def progress_line(bag_ns: int, end_ns: int, rate: float, state: str) -> str:
    """Return the line, see Progress.show."""
    at_ns = min(max(bag_ns, 0), end_ns)
    done = at_ns / end_ns if end_ns else 1.0
    bar = ('#' * int(BAR * done)).ljust(BAR, '-')
    return f'[{bar}] {at_ns / NS_PER_S:.1f} of {end_ns / NS_PER_S:.1f} s x{rate:g} {state}'
