"""What a person sees of a run: lines of the nodes, and a live block on a terminal."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import TextIO

from layered_cbf_ros.supervision.status_table import Row, table_lines

COLOURS = (36, 33, 32, 35, 34, 96, 93, 92, 95, 94)
BAR = 30
DIM = 2


def progress_line(clock: float | None, duration: float, wall: float, paused: bool = False) -> str:
    """Return simulated time as a bar, with the real-time factor.

    Args:
        clock: Simulated time [s], None before the first word of it.
        duration: Longest simulated time of the run [s].
        wall: Wall time since the start of the simulation, without pauses [s].
        paused: Whether the time stands still.
    """
    if clock is None:
        return f'[{"-" * BAR}] {"paused" if paused else "starting"}'
    done = min(1.0, clock / duration)
    bar = ('#' * round(BAR * done)).ljust(BAR, '-')
    factor = f', real-time factor {clock / wall:.2f}' if wall > 0.0 else ''
    return f'[{bar}] {clock:.1f} of {duration:g} s{factor}{", paused" if paused else ""}'


class Printer:
    """Prints lines and, on a terminal, keeps a block of status below them."""

    def __init__(self, stream: TextIO, terminal: bool, pipe_pause: float = 10.0) -> None:
        """Choose how to print.

        Args:
            stream: Where to.
            terminal: Whether it is a terminal: colours and a live block, or plain lines.
            pipe_pause: Wall time between status lines where there is no block [s].
        """
        self._stream = stream
        self._terminal = terminal
        self._pipe_pause = pipe_pause
        self._next_status = 0.0
        self._block: list[str] = []
        self._shown = 0
        self._colours: dict[str, int] = {}

    def tell(self, name: str, text: str) -> None:
        """Print a line of, or about, a node."""
        colour = self._colours.setdefault(name, COLOURS[len(self._colours) % len(COLOURS)])
        self.say(f'{self._painted(name, colour)}: {text}')

    def say(self, text: str) -> None:
        """Print text above the block."""
        self._erase()
        print(text, file=self._stream)
        self._draw()

    def status(self, now: float, progress: str, rows: Sequence[Row]) -> None:
        """Show how the run goes; where there is no terminal, now and then."""
        if self._terminal:
            columns = shutil.get_terminal_size().columns
            table = table_lines(rows, columns, coloured=True)
            self.show([*table, self._painted(progress[: columns - 1], DIM)])
        elif now >= self._next_status:
            self._next_status = now + self._pipe_pause
            print(progress, file=self._stream, flush=True)

    def show(self, lines: Sequence[str]) -> None:
        """Make these lines the block; where there is no terminal, print them."""
        self._erase()
        self._block = list(lines)
        self._draw()
        if not self._terminal:
            self._block, self._shown = [], 0

    def end(self) -> None:
        """Remove the block."""
        self._erase()
        self._block = []
        self._stream.flush()

    def _painted(self, text: str, code: int) -> str:
        return f'\x1b[{code}m{text}\x1b[0m' if self._terminal else text

    def _erase(self) -> None:
        if self._shown:
            self._stream.write(f'\x1b[{self._shown}F\x1b[J')
            self._shown = 0

    def _draw(self) -> None:
        for line in self._block:
            print(line, file=self._stream)
        self._shown = len(self._block)
        self._stream.flush()
