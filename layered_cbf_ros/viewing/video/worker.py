"""A process that draws: frames come in on its input, pictures go out, until the input ends."""

from __future__ import annotations

import os
import pickle
import sys

from layered_cbf_ros.viewing.video.renderer import Renderer


def main() -> None:
    """Draw one frame after the other."""
    output = os.fdopen(os.dup(sys.stdout.fileno()), 'wb')
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # a library that prints spoils no picture
    renderer = Renderer()
    while True:
        try:
            frame = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        output.write(renderer.draw(frame).tobytes())
        output.flush()


if __name__ == '__main__':
    main()
