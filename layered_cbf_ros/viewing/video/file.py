"""Files of moving pictures: mp4 through ffmpeg, GIF through Pillow; whole, or not there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

from PIL import Image

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.viewing.palette import FLOOR, ROBOTS, SKY, barrier_colour, lighter

GIF_COLOURS = 192
GREYS = 16
QUALITY = '21'  # x264's rate factor: hardly any loss is seen
MOST_GIF_FPS = 50
SUFFIXES = ('.mp4', '.gif')


def check_encoder(path: Path) -> None:
    """Make sure that a video of this suffix can be written here.

    Raises:
        BagError: If it can't, with the remedy.
    """
    if path.suffix not in SUFFIXES:
        known = ' or '.join(SUFFIXES)
        raise BagError(f"--video {path}: unknown suffix '{path.suffix}'; give {known}")
    if path.suffix == '.mp4':
        try:
            import imageio_ffmpeg  # noqa: F401
        except ImportError:
            raise BagError(
                f'--video {path}: mp4 needs an encoder; pip install imageio-ffmpeg, or give .gif'
            ) from None


def shown_fps(path: Path, fps: float) -> float:
    """Return the pictures a second that the format can show: GIF counts hundredths of a second."""
    return 100.0 / max(round(100.0 / fps), 2) if path.suffix == '.gif' else fps


def write_video(pictures: Iterable[Image.Image], path: Path, fps: float) -> None:
    """Write pictures as a video; under its name there is a whole one or none.

    Args:
        pictures: All of one size; at least one.
        path: Where to, of a suffix that `check_encoder` accepts.
        fps: Pictures a second, as `shown_fps` gives them.

    Raises:
        BagError: If it can't be written.
    """
    with _whole(path) as unfinished:
        try:
            if path.suffix == '.gif':
                _write_gif(pictures, unfinished, fps)
            else:
                _write_mp4(pictures, unfinished, fps)
        except OSError as error:
            reason = error.strerror or 'the encoder ended; is the disk full?'
            raise BagError(f'--video {path} cannot be written: {reason}') from None


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Give a name beside a file's own, which it gets at the end, if there is no error."""
    unfinished = path.with_name(f'.{path.stem}.{os.getpid()}{path.suffix}')
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _write_mp4(pictures: Iterable[Image.Image], path: Path, fps: float) -> None:
    import imageio_ffmpeg

    encoder: Any = None
    try:
        for picture in pictures:
            if encoder is None:
                encoder = imageio_ffmpeg.write_frames(
                    str(path), picture.size, fps=fps, macro_block_size=2, ffmpeg_log_level='error',
                    output_params=['-crf', QUALITY, '-movflags', '+faststart'],
                )  # fmt: skip
                encoder.send(None)
            encoder.send(picture.tobytes())
    finally:
        if encoder is not None:
            encoder.close()


def _write_gif(pictures: Iterable[Image.Image], path: Path, fps: float) -> None:
    """Write a GIF whose pictures share one palette, so that only what changes is stored."""
    shown = iter(pictures)
    first = next(shown)
    palette = _palette(first)
    flat = (
        picture.quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in chain([first], shown)
    )
    next(flat).save(
        path, save_all=True, append_images=flat, duration=round(1000.0 / fps), loop=0, optimize=True
    )  # fmt: skip


def _palette(picture: Image.Image) -> Image.Image:
    """Return a palette for all pictures of a run: the colours of one, and those that may come.

    Bodies come into view later, and h changes its colour.
    """
    wanted = [FLOOR, SKY, *(lighter((0, 0, 0), k / GREYS) for k in range(GREYS + 1))]
    wanted += [lighter(barrier_colour(0.1 * k), share) for k in range(11) for share in (0.1, 0.65)]
    wanted += [lighter(colour, 0.2 * k) for colour in ROBOTS for k in range(5)]
    seen = picture.quantize(GIF_COLOURS - len(wanted), method=Image.Quantize.MEDIANCUT)
    palette = Image.new('P', (1, 1))
    palette.putpalette([part for colour in wanted for part in colour] + (seen.getpalette() or []))
    return palette
