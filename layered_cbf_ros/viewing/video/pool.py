"""Draws the frames of a video in several processes: a picture takes a tenth of a second."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Iterable, Iterator

from PIL import Image

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.viewing.video.frame import Frame

MOST_WORKERS = 8
WORKER = 'layered_cbf_ros.viewing.video.worker'


class _Worker:
    """One process that draws one frame at a time; it ends when this one does."""

    def __init__(self) -> None:
        # In a session of its own: Ctrl-C is for the parent, whose end it sees on its input.
        self._process = subprocess.Popen(
            [sys.executable, '-m', WORKER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self._size: tuple[int, int] | None = None

    def begin(self, frame: Frame) -> None:
        """Hand a frame over, once the picture before was taken."""
        assert self._process.stdin is not None
        self._size = frame.camera.width, frame.camera.height
        try:
            pickle.dump(frame, self._process.stdin)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise _ended() from None

    def picture(self) -> Image.Image | None:
        """Wait for the picture of the frame it has; None if it has none.

        Raises:
            LayeredCbfError: If the process ended.
        """
        if self._size is None:
            return None
        assert self._process.stdout is not None
        size, self._size = self._size, None
        pixels = self._process.stdout.read(3 * size[0] * size[1])
        if len(pixels) < 3 * size[0] * size[1]:
            raise _ended()
        return Image.frombytes('RGB', size, pixels)

    def end(self) -> None:
        """Let it go, whatever it is doing."""
        self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            try:
                stream.close()
            except BrokenPipeError:
                continue  # part of a frame that nobody will draw
        self._process.wait()


def pictures(frames: Iterable[Frame]) -> Iterator[Image.Image]:
    """Yield the picture of each frame, in their order.

    Raises:
        LayeredCbfError: If a process that draws ended.
    """
    workers = [_Worker() for _ in range(min(len(os.sched_getaffinity(0)), MOST_WORKERS))]
    turns = deque(workers)  # who has the oldest frame comes first
    try:
        for frame in frames:
            picture = turns[0].picture()
            turns[0].begin(frame)
            turns.rotate(-1)
            if picture is not None:
                yield picture
        for worker in turns:
            picture = worker.picture()
            if picture is not None:
                yield picture
    finally:
        for worker in workers:
            worker.end()


def _ended() -> LayeredCbfError:
    return LayeredCbfError('video: a process that draws has ended; is there memory enough?')
