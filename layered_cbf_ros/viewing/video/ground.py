"""What lies flat on the ground: grid, walls, reachable sets, balls, trails and arrows."""

from __future__ import annotations

import math

import numpy as np
from PIL import ImageDraw

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Wall
from layered_cbf_ros.viewing.palette import WALL, Colour
from layered_cbf_ros.viewing.video.camera import Camera, cut_in_front

GRID = (214, 217, 222)
FAR = 30.0  # how far the grid goes [m]
RING = np.linspace(0.0, 2.0 * np.pi, 49)
DASHES = 28  # of a dashed circle
ARROW_SECONDS = 1.0
"""A velocity is drawn as the way it leads in this time [s]."""


class Ground:
    """Draws on the plane z = 0; widths are in pixels of a picture that is 720 high."""

    def __init__(self, draw: ImageDraw.ImageDraw, camera: Camera, scale: float) -> None:
        """Begin.

        Args:
            draw: The canvas, with blending.
            camera: Of the canvas.
            scale: Pixels of the canvas for one of a picture that is 720 high.
        """
        self._draw, self._camera, self._scale = draw, camera, scale

    def grid(self) -> None:
        """Draw a line a metre."""
        x, y = (math.floor(part) for part in self._camera.target)
        for k in range(-round(FAR), round(FAR) + 1):
            self._line([(x + k, y - FAR), (x + k, y + FAR)], (*GRID, 255), 1.0)
            self._line([(x - FAR, y + k), (x + FAR, y + k)], (*GRID, 255), 1.0)

    def wall(self, wall: Wall) -> None:
        """Shade the side of a wall that is forbidden."""
        point, normal = np.array(wall.point), np.array(wall.normal)
        along = np.array([-normal[1], normal[0]]) * FAR
        middle = point + along * float(along @ (self._camera.target - point)) / FAR**2
        corners = [middle - along, middle + along]
        outer = [corners[1] - FAR * normal, corners[0] - FAR * normal]
        self._area(np.array([*corners, *outer]), (*WALL, 90))
        self._line(corners, (*WALL, 255), 3.0)

    def disc(self, centre: Array, radius: float, colour: Colour, fill: int, edge: int) -> None:
        """Draw a disc.

        Args:
            centre: [m], (2,).
            radius: [m].
            colour: Of all of it.
            fill, edge: How much of the inside, and of the edge, covers what is below, of 255.
        """
        ring = _ring(centre, radius)
        if fill:
            self._area(ring, (*colour, fill))
        if edge:
            self._line(ring, (*colour, edge), 1.6)

    def dashed_circle(self, centre: Array, radius: float, colour: Colour, edge: int) -> None:
        """Draw a circle of dashes."""
        for start in np.arange(DASHES) * 2.0 * np.pi / DASHES:
            angles = start + np.linspace(0.0, np.pi / DASHES, 4)
            points = centre + radius * np.column_stack((np.cos(angles), np.sin(angles)))
            self._line(points, (*colour, edge), 1.4)

    def trail(self, points: Array, colour: Colour) -> None:
        """Draw where a body came along, fainter the longer ago.

        Args:
            points: The oldest first [m], (n, 2).
            colour: Of the robot.
        """
        for k in range(1, len(points)):
            self._line(points[k - 1 : k + 1], (*colour, round(170 * k / len(points))), 2.4)

    def arrow(self, start: Array, velocity: Array, colour: Colour, edge: int, width: float) -> None:
        """Draw a velocity as an arrow from a point.

        Args:
            start: [m], (2,).
            velocity: [m/s], (2,).
            colour: Of the arrow.
            edge: How much of it covers what is below, of 255.
            width: Of the shaft [pixel].
        """
        speed = float(np.hypot(*velocity))
        if speed < 0.02:
            return
        way = velocity * ARROW_SECONDS
        ahead = way / (speed * ARROW_SECONDS)
        aside = np.array([-ahead[1], ahead[0]])
        head = min(0.16, 0.5 * speed * ARROW_SECONDS)
        tip, neck = start + way, start + way - head * ahead
        self._line([start, neck], (*colour, edge), width)
        self._area(np.array([tip, neck + 0.45 * head * aside, neck - 0.45 * head * aside]),
                   (*colour, edge))  # fmt: skip

    def _area(self, corners: Array, paint: tuple[int, int, int, int]) -> None:
        shown = cut_in_front(self._camera, np.column_stack((corners, np.zeros(len(corners)))))
        if len(shown) > 2:
            self._draw.polygon(self._camera.project(shown).ravel().tolist(), fill=paint)

    def _line(self, points: object, paint: tuple[int, int, int, int], width: float) -> None:
        flat = np.asarray(points, dtype=float)
        shown = np.column_stack((flat, np.zeros(len(flat))))
        if float(self._camera.depth(shown).min()) < 0.0:
            shown = _cut_line(self._camera, shown)
        if len(shown) > 1:
            pixels = self._camera.project(shown).ravel().tolist()
            thick = max(round(width * self._scale), 1)
            self._draw.line(pixels, fill=paint, width=thick, joint='curve')


def _ring(centre: Array, radius: float) -> Array:
    ring: Array = centre + radius * np.column_stack((np.cos(RING), np.sin(RING)))
    return ring


def _cut_line(camera: Camera, points: Array) -> Array:
    """Return the part of a straight line in front of the camera; nothing of a bent one."""
    return np.unique(cut_in_front(camera, points), axis=0) if len(points) == 2 else points[:0]
