"""Which instants of a run become the pictures of a video, and from where each is seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.history import CHART_NS, History
from layered_cbf_ros.viewing.sight.bag_sight import BagSight
from layered_cbf_ros.viewing.sight.snapshot import Snapshot
from layered_cbf_ros.viewing.video.camera import ELEVATION, FIELD_OF_VIEW, Camera
from layered_cbf_ros.viewing.video.frame import Frame

FOLLOWING = 5.6  # distance of a camera that follows one robot [m]
ROOM = 1.3  # around all bodies, when all are to be seen [m]
NEAREST = 4.5  # a camera that sees all comes no nearer [m]
LAG = 0.8  # the camera follows with this time constant of the run [s]
BEFORE = 0.1  # step at which the time before the first picture is looked at [s]


@dataclass(frozen=True, slots=True)
class VideoWish:
    """What is asked for.

    Attributes:
        begin, end: Time since the first state [s].
        speed: Seconds of the run in a second of the video.
        fps: Pictures a second.
        width, height: Of a picture [pixel].
        follow: Name of the robot in the middle; empty to see all bodies.
    """

    begin: float
    end: float
    speed: float
    fps: float
    width: int
    height: int
    follow: str = ''

    @property
    def step(self) -> float:
        """Time of the run from one picture to the next [s]."""
        return self.speed / self.fps

    @property
    def count(self) -> int:
        """How many pictures there will be."""
        return math.floor((self.end - self.begin) / self.step + 1e-6) + 1


def frames(sight: BagSight, wish: VideoWish) -> Iterator[Frame]:
    """Yield the frames of a video in their order."""
    history = _history_before(sight, wish.begin)
    aim: Array | None = None
    gain = 1.0 - math.exp(-wish.step / LAG)
    for k in range(wish.count):
        seconds = wish.begin + k * wish.step
        snapshot = sight.at(seconds)
        history = history.after(snapshot)
        wanted = aim_at(snapshot, wish)
        aim = wanted if aim is None else aim + gain * (wanted - aim)
        camera = Camera(aim[:2], float(aim[2]), wish.width, wish.height)
        yield Frame(snapshot, camera, history, seconds)


def aim_at(snapshot: Snapshot, wish: VideoWish) -> Array:
    """Return where to look at, and from how far: x, y, distance [m], (3,)."""
    places = {robot.name: robot.configuration[:2] for robot in snapshot.robots}
    if wish.follow in places:
        return np.array([*places[wish.follow], FOLLOWING])
    points = np.array([*places.values(), *(thing.position for thing in snapshot.obstacles)])
    if not len(points):
        return np.array([0.0, 0.0, FOLLOWING])
    low, high = points.min(axis=0) - ROOM, points.max(axis=0) + ROOM
    half_width, half_depth = 0.5 * (high - low)
    across = math.tan(0.5 * FIELD_OF_VIEW)
    # The near edge is closest to the camera, hence the narrowest part of the view.
    near = half_depth * math.cos(ELEVATION)
    wide = near + half_width * wish.height / (wish.width * across)
    deep = near + half_depth * math.sin(ELEVATION) / across
    return np.array([*(0.5 * (low + high)), max(wide, deep, NEAREST)])


def _history_before(sight: BagSight, begin: float) -> History:
    """Return what trails and chart show at the first picture."""
    history = History()
    seconds = max(begin - CHART_NS * 1e-9, 0.0)
    while seconds < begin:
        history = history.after(sight.at(seconds))
        seconds += BEFORE
    return history
