"""Renders the video of a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image

from layered_cbf_ros.viewing.sight.bag_sight import BagSight
from layered_cbf_ros.viewing.video.file import write_video
from layered_cbf_ros.viewing.video.frames import VideoWish, frames
from layered_cbf_ros.viewing.video.pool import pictures

Show = Callable[[int, int], None]
"""Is told how many pictures are done, and of how many."""


def render(sight: BagSight, wish: VideoWish, path: Path, show: Show) -> None:
    """Render a video.

    Args:
        sight: The run.
        wish: Which part of it, and how.
        path: Where to.
        show: Told of every picture.

    Raises:
        LayeredCbfError: If it can't be drawn or written.
    """

    def told() -> Iterator[Image.Image]:
        drawn = pictures(frames(sight, wish))
        for done, picture in enumerate(drawn, start=1):
            yield picture
            show(done, wish.count)

    write_video(told(), path, wish.fps)
