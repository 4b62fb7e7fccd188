"""`inspect BAG --video FILE`: renders the run of a bag, and checks first that it can."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.yaml_entry import suggestion

if TYPE_CHECKING:
    from layered_cbf_ros.viewing.sight.bag_sight import BagSight
    from layered_cbf_ros.viewing.video.frames import VideoWish

FLAGS = {'from_': '--from', 'to': '--to', 'speed': '--speed', 'size': '--size', 'fps': '--fps',
         'follow': '--follow'}  # fmt: skip
OTHERS = ('topic', 'count', 'start_offset', 'playback_duration', 'plot', 'export', 'output', 'json',
          'repair')  # fmt: skip
MP4: dict[str, float | str] = {'speed': 1.0, 'fps': 30.0, 'size': '1280x720'}
GIF: dict[str, float | str] = {'speed': 4.0, 'fps': 10.0, 'size': '640x360'}
MOST_FPS, MOST_SPEED = 60.0, 1000.0
LEAST_SIZE, MOST_SIZE = 120, 3840


def add_video_options(parser: argparse.ArgumentParser) -> None:
    """Add `--video` and what belongs to it."""
    add = parser.add_argument_group('video of the run').add_argument
    add('--video', type=Path, metavar='FILE', help='render the run as .mp4 or .gif; no display')
    add('--from', dest='from_', type=float, metavar='S', help='begin so long after the first state')
    add('--to', type=float, metavar='S', help='end so long after the first state')
    add('--speed', type=float, metavar='X', help='times real time: mp4 1, gif 4 by default')
    add('--size', metavar='WxH', help='pixels: mp4 1280x720, gif 640x360 by default')
    add('--fps', type=float, metavar='N', help='pictures a second: mp4 30, gif 10 by default')
    add('--follow', metavar='ROBOT', help='keep one robot in the middle, from near')


def check_video_options(options: argparse.Namespace) -> None:
    """Make sure that the options go together.

    Raises:
        BagError: If they don't.
    """
    if options.video is None:
        for name, flag in FLAGS.items():
            if getattr(options, name) is not None:
                raise BagError(f'{flag} belongs to a video; give --video FILE too')
        return
    for name in OTHERS:
        if getattr(options, name) not in (None, [], False):
            raise BagError(f'--video stands alone; leave out --{name.replace("_", "-")}')


def make_video(options: argparse.Namespace) -> None:
    """Render the video that the command line asks for.

    Raises:
        LayeredCbfError: If the command is bad, or the video can't be drawn or written.
    """
    from layered_cbf_ros.viewing.sight.bag_sight import BagSight  # loads the robot's meshes
    from layered_cbf_ros.viewing.video.file import check_encoder
    from layered_cbf_ros.viewing.video.video import render

    path = options.video
    check_encoder(path)
    _check_file(path, options.force)
    width, height = _size(options)
    speed = _number(options, 'speed', MOST_SPEED)
    fps = _number(options, 'fps', MOST_FPS)
    sight = BagSight(options.bag)
    wish = _wish(options, sight, speed, fps, (width, height))
    progress = Progress(sys.stderr)
    render(sight, wish, path, progress.show)
    progress.end()
    seconds, size = wish.count / wish.fps, path.stat().st_size / 1e6
    print(f'written: {path}, {wish.count} pictures, {seconds:.1f} s, {size:.1f} MB')
    if sight.truncated:
        print(f'{options.bag} was cut off; the video ends where it ends')


class Progress:
    """Counts pictures on a terminal; elsewhere it is silent."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._shown = stream, stream.isatty()

    def show(self, done: int, count: int) -> None:
        """Show how far it is."""
        if self._shown:
            print(f'\rvideo: {done} of {count} pictures', end='', file=self._stream, flush=True)

    def end(self) -> None:
        """Begin a new line."""
        if self._shown:
            print(file=self._stream)


def _check_file(path: Path, force: bool) -> None:
    if path.exists() and not force:
        raise BagError(f'{path} exists already; choose another name for --video, or --force')
    if not path.parent.is_dir():
        raise BagError(f'--video {path}: there is no folder {path.parent}; make it first')


def _number(options: argparse.Namespace, name: str, most: float) -> float:
    """Return a positive number that was asked for, or what the format has by default."""
    value = getattr(options, name)
    if value is None:
        return float(_defaults(options.video)[name])
    if not 0.0 < value <= most:
        raise BagError(f'{FLAGS[name]} is {value:g}; give a number above 0, at most {most:g}')
    return float(value)


def _size(options: argparse.Namespace) -> tuple[int, int]:
    """Return width and height of the pictures [pixel]; even ones, as mp4 needs them."""
    text = options.size or _defaults(options.video)['size']
    parts = str(text).lower().split('x')
    if len(parts) == 2 and all(part.isascii() and part.isdigit() for part in parts):
        width, height = map(int, parts)
        if all(LEAST_SIZE <= n <= MOST_SIZE and n % 2 == 0 for n in (width, height)):
            return width, height
    raise BagError(
        f'--size is {text}; give WIDTHxHEIGHT, even numbers from {LEAST_SIZE} to {MOST_SIZE}'
    )


def _wish(
    options: argparse.Namespace,
    sight: BagSight,
    speed: float,
    fps: float,
    size: tuple[int, int],
) -> VideoWish:
    """Return which part of the run is wanted, and how."""
    from layered_cbf_ros.viewing.video.file import shown_fps
    from layered_cbf_ros.viewing.video.frames import VideoWish

    begin = 0.0 if options.from_ is None else options.from_
    end = sight.duration if options.to is None else min(options.to, sight.duration)
    if not 0.0 <= begin < math.inf:
        raise BagError(f'--from is {begin:g}; give seconds since the first state, from 0 on')
    if not begin < end:
        upper = f'--to is {options.to:g}' if options.to is not None else 'the end'
        raise BagError(
            f'--from is {begin:g} and {upper}, of {sight.duration:.1f} s in the bag; '
            'begin before the end'
        )
    robots = [robot.name for robot in sight.scenario.robots]
    if options.follow is not None and options.follow not in robots:
        raise BagError(
            f"--follow: no robot '{options.follow}'; {suggestion(options.follow, robots)}"
            f'there are {", ".join(robots)}'
        )
    fps = shown_fps(options.video, fps)
    return VideoWish(begin, end, speed, fps, *size, options.follow or '')


def _defaults(path: Path) -> dict[str, float | str]:
    return GIF if path.suffix == '.gif' else MP4
