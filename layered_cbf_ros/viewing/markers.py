"""What tools such as RViz and Foxglove are to draw of a snapshot, without knowing of ROS."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Wall
from layered_cbf_ros.viewing.history import History
from layered_cbf_ros.viewing.links import Links
from layered_cbf_ros.viewing.palette import (
    DESIRED,
    OBSTACLE,
    WALL,
    Colour,
    barrier_colour,
    robot_colour,
)
from layered_cbf_ros.viewing.sight.snapshot import RobotSight, Snapshot

IDENTITY = (0.0, 0.0, 0.0, 1.0)
TRUNK_SIZE = (0.267, 0.194, 0.114)  # of the description's collision box [m]
FLAT = 0.004  # thickness of what lies on the ground [m]
NAME_HEIGHT, NAME_SIZE = 0.5, 0.14
WALL_SIZE = (60.0, 0.05, 0.3)
NEWTON = 1.0 / 250.0  # length of a force of 1 N [m]
SHAFT = 0.03  # diameter of an arrow [m]


class Kind(IntEnum):
    """Shapes, numbered as in visualization_msgs/Marker."""

    ARROW = 0
    CUBE = 1
    CYLINDER = 3
    LINE_STRIP = 4
    LINE_LIST = 5
    TEXT = 9


@dataclass(frozen=True, slots=True)
class Mark:
    """One shape in the world.

    Attributes:
        group: What it tells of: who looks can switch groups off.
        name: Its name in the group; the same shape has the same name every time.
        kind: Which shape.
        size: As `scale` of visualization_msgs/Marker [m].
        colour: Red, green, blue, opacity, each in [0, 1].
        position: [m], (3,).
        quaternion: x, y, z, w.
        points: Of arrows and lines [m], (n, 3); in the world.
        text: Of TEXT.
    """

    group: str
    name: str
    kind: Kind
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = IDENTITY
    points: Array | None = None
    text: str = ''


def marks(snapshot: Snapshot, history: History, links: Links) -> Iterator[Mark]:
    """Yield all shapes of a snapshot.

    Args:
        snapshot: What is to be seen.
        history: Where robots came along.
        links: Of an A1, for its legs.
    """
    for wall in snapshot.walls:
        yield _wall(wall)
    for thing in snapshot.obstacles:
        place = (*thing.position.tolist(), 0.5 * thing.height)
        size = (2.0 * thing.radius, 2.0 * thing.radius, thing.height)
        paint = _paint(OBSTACLE, 1.0)
        yield Mark('obstacles', thing.name, Kind.CYLINDER, size, paint, place)
        yield from _arrow('obstacles', f'{thing.name} velocity', thing.position, thing.velocity,
                          OBSTACLE)  # fmt: skip
        yield _name(thing.name, thing.position, thing.height + 0.15, OBSTACLE)
    for ball in (known for known in snapshot.balls if math.isfinite(known.h + known.radius)):
        opacity = 0.45 - 0.35 * min(max(ball.h, 0.0), 1.0)  # what is near counts
        colour = barrier_colour(ball.h)
        yield _disc('balls', ball.label, ball.centre, ball.radius, colour, opacity, FLAT)
    for index, robot in enumerate(snapshot.robots):
        yield from _robot(robot, robot_colour(index), history.trail(robot.name), links)


def _robot(robot: RobotSight, colour: Colour, trail: Array, links: Links) -> Iterator[Mark]:
    """Yield all that belongs to one robot."""
    name, centre = robot.name, robot.configuration[:2]
    yield from _body(robot, colour, links)
    yield _name(name, centre, NAME_HEIGHT, colour)
    yield _disc('reachable_sets', name, robot.reach[:2], float(robot.reach[2]), colour, 0.25, 0.0)
    yield from _arrow('desired', name, centre, robot.target, DESIRED)
    if robot.plan is not None:
        yield from _arrow('safe', name, robot.plan.position, robot.plan.velocity, colour)
    if len(trail) > 1:
        line = np.column_stack((trail, np.full(len(trail), FLAT)))
        yield Mark('trails', name, Kind.LINE_STRIP, (0.02, 0.0, 0.0), _paint(colour, 0.8),
                   points=line)  # fmt: skip
    if robot.has_legs:
        for foot, force in enumerate(robot.foot_forces):
            if np.linalg.norm(force) * NEWTON > SHAFT:
                start = robot.foot_positions[foot]
                yield Mark('forces', f'{name} {foot}', Kind.ARROW, (0.015, 0.03, 0.04),
                           _paint((226, 74, 51), 0.9),
                           points=np.array([start, start + NEWTON * force]))  # fmt: skip


def _body(robot: RobotSight, colour: Colour, links: Links) -> Iterator[Mark]:
    """Yield trunk and legs as simple shapes; or a disc if there are no legs."""
    q = robot.configuration.tolist()
    turn = q[3], q[4], q[5], q[6]
    paint = _paint(colour, 1.0)
    if not robot.has_legs:
        size = (2.0 * robot.radius, 2.0 * robot.radius, TRUNK_SIZE[2])
        place = q[0], q[1], 0.5 * TRUNK_SIZE[2]
        yield Mark('bodies', robot.name, Kind.CYLINDER, size, paint, place, turn)
        return
    yield Mark('bodies', robot.name, Kind.CUBE, TRUNK_SIZE, paint, (q[0], q[1], q[2]), turn)
    legs = links.legs(robot.configuration)
    segments = np.stack((legs[:, :-1], legs[:, 1:]), axis=2).reshape(-1, 3)
    yield Mark('bodies', f'{robot.name} legs', Kind.LINE_LIST, (0.03, 0.0, 0.0),
               _paint((70, 74, 80), 1.0), points=segments)  # fmt: skip


def _wall(wall: Wall) -> Mark:
    """Return a wall as a box; it begins where the allowed side ends."""
    length, thickness, height = WALL_SIZE
    nx, ny = wall.normal
    yaw = np.arctan2(-nx, ny)  # its length runs along (ny, -nx)
    centre = (wall.point[0] - 0.5 * thickness * nx, wall.point[1] - 0.5 * thickness * ny)
    turn = (0.0, 0.0, float(np.sin(0.5 * yaw)), float(np.cos(0.5 * yaw)))
    place = (*centre, 0.5 * height)
    size = (length, thickness, height)
    return Mark('walls', wall.name, Kind.CUBE, size, _paint(WALL, 0.6), place, turn)


def _disc(
    group: str, name: str, centre: Array, radius: float, colour: Colour, alpha: float, z: float
) -> Mark:
    """Return a flat disc; z keeps discs of different groups apart [m]."""
    size = (2.0 * radius, 2.0 * radius, FLAT)
    place = (*centre.tolist(), z + 0.5 * FLAT)
    return Mark(group, name, Kind.CYLINDER, size, _paint(colour, alpha), place)


def _arrow(group: str, name: str, start: Array, velocity: Array, colour: Colour) -> Iterator[Mark]:
    """Yield a velocity as the way it leads in a second, unless it is next to nothing."""
    if float(np.hypot(*velocity)) > SHAFT:
        ends = np.array([start, start + velocity])
        points = np.column_stack((ends, np.full(2, SHAFT)))
        size = (SHAFT, 2.0 * SHAFT, 3.0 * SHAFT)
        yield Mark(group, name, Kind.ARROW, size, _paint(colour, 0.9), points=points)


def _name(name: str, centre: Array, height: float, colour: Colour) -> Mark:
    place = (*centre.tolist(), height)
    size = (0.0, 0.0, NAME_SIZE)
    return Mark('names', name, Kind.TEXT, size, _paint(colour, 1.0), place, text=name)


def _paint(colour: Colour, opacity: float) -> tuple[float, float, float, float]:
    red, green, blue = (part / 255.0 for part in colour)
    return red, green, blue, opacity


class Numbers:
    """Gives every mark a number of its own, and tells which have vanished."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, int]] = {}
        self._shown: set[tuple[str, int]] = set()

    def number(self, mark: Mark) -> int:
        """Return the number of a mark in its group: the same one every time."""
        group = self._known.setdefault(mark.group, {})
        return group.setdefault(mark.name, len(group))

    def vanished(self, shown: set[tuple[str, int]]) -> set[tuple[str, int]]:
        """Take note of what is shown; return group and number of what was, and isn't any more."""
        gone = self._shown - shown
        self._shown = shown
        return gone
