"""The terminal of a program with a screen of its own: entered, read, painted, and left as it was.

Whatever ends the program, even a kill, the terminal is usable afterwards: a small child
process outlives it for a moment and puts things back if nobody else has.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import termios
from types import TracebackType
from typing import Any

from layered_cbf_ros.errors import LayeredCbfError

DEVICE = '/dev/tty'
MANY = 4096  # more than a terminal keeps: nothing old is left behind
_ENTER = b'\x1b[?1049h\x1b[?25l\x1b[2J'  # a screen of its own, no cursor
_LEAVE = b'\x1b[0m\x1b[?25h\x1b[?1049l'
_OVER = b'\x1b[H'
_DONE = b'.'


class Terminal:
    """Keys without Enter and a screen of its own, while it is entered as a context.

    Ctrl-C stays a signal. Reading and painting never wait: a terminal that doesn't take
    its picture, as over a slow network, must not keep the keys from being read.
    """

    def __init__(self) -> None:
        """Open the terminal that the process was started from.

        Raises:
            LayeredCbfError: If there is none.
        """
        try:
            self._fd = os.open(DEVICE, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise LayeredCbfError(f'{DEVICE} cannot be opened: {error.strerror}') from None
        self._before = termios.tcgetattr(self._fd)
        self._ours = _without_line_editing(self._before)
        self._guard: tuple[int, int] | None = None
        self._size = os.terminal_size((0, 0))

    def __enter__(self) -> Terminal:
        self._guard = _start_guard(self._fd, self._before, self._ours)
        self.take_over()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.give_back()
        if self._guard is not None:
            child, pipe = self._guard
            os.write(pipe, _DONE)
            os.close(pipe)
            os.waitpid(child, 0)
        os.close(self._fd)

    def take_over(self) -> None:
        """Show the program's own screen; what was typed before doesn't count."""
        self._size = os.terminal_size((0, 0))
        with contextlib.suppress(OSError, termios.error):  # the terminal is gone
            termios.tcsetattr(self._fd, termios.TCSAFLUSH, self._ours)
            os.write(self._fd, _ENTER)

    def give_back(self) -> None:
        """Show what was there before, with its cursor and its line editing."""
        _put_back(self._fd, self._before)

    def read(self, timeout_s: float) -> bytes | None:
        """Return the bytes of the keys that were pressed, None if the terminal is gone.

        Args:
            timeout_s: How long to wait for one [s].
        """
        try:
            if not select.select([self._fd], [], [], timeout_s)[0]:
                return b''
            return os.read(self._fd, MANY) or None
        except (InterruptedError, BlockingIOError):
            return b''
        except OSError:
            return None

    @property
    def size(self) -> os.terminal_size:
        """Return columns and lines."""
        try:
            size = os.get_terminal_size(self._fd)
        except OSError:
            return os.terminal_size((80, 24))
        return size if size.columns and size.lines else os.terminal_size((80, 24))

    def paint(self, lines: list[str]) -> None:
        """Paint a picture over the last one, in one go: that doesn't flicker."""
        size = self.size
        clear = b'\x1b[2J' if size != self._size else b''
        self._size = size
        rows = '\x1b[0m\x1b[K\r\n'.join(lines[: size.lines])
        picture = clear + _OVER + rows.encode('ascii', 'replace') + b'\x1b[0m\x1b[K\x1b[J'
        try:
            done = os.write(self._fd, picture)
        except OSError:  # it takes nothing now; the next picture is whole
            done = 0
        if done < len(picture):
            self._size = os.terminal_size((0, 0))


def _without_line_editing(modes: list[Any]) -> list[Any]:
    """Return terminal modes in which keys come at once and Ctrl-S doesn't freeze the screen."""
    iflag, oflag, cflag, lflag, *rest = modes
    return [iflag & ~termios.IXON, oflag, cflag, lflag & ~(termios.ICANON | termios.ECHO), *rest]


def _put_back(fd: int, modes: list[Any]) -> None:
    with contextlib.suppress(OSError):
        os.write(fd, _LEAVE)
    with contextlib.suppress(termios.error):
        termios.tcsetattr(fd, termios.TCSAFLUSH, modes)


def _start_guard(fd: int, before: list[Any], ours: list[Any]) -> tuple[int, int]:
    """Start the child that puts the terminal back should this process be killed.

    Returns:
        The child's process number, and the end of the pipe that tells it that all is well.
    """
    inner, outer = os.pipe()
    child = os.fork()
    if child:
        os.close(inner)
        return child, outer
    try:  # from here on in the child
        os.close(outer)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN)
        for number in (signal.SIGTTOU, signal.SIGTSTP):
            signal.signal(number, signal.SIG_IGN)
        well = os.read(inner, 1) == _DONE
        if not well and termios.tcgetattr(fd)[3] == ours[3]:  # no shell was faster
            os.set_blocking(fd, True)
            _put_back(fd, before)
    finally:
        os._exit(0)
