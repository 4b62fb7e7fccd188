"""A pinhole camera that looks down on the plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import Array

FIELD_OF_VIEW = math.radians(34.0)  # vertical
ELEVATION = math.radians(42.0)  # of the camera over what it looks at
NEAR = 0.05  # nothing nearer is drawn [m]


@dataclass(frozen=True, slots=True)
class Camera:
    """Where the camera is, and how large its picture.

    Attributes:
        target: Point of the ground in the middle of the picture [m], (2,).
        distance: From there to the camera [m].
        width, height: Of the picture [pixel].
    """

    target: Array
    distance: float
    width: int
    height: int

    @property
    def position(self) -> Array:
        """Where it is in the world [m], (3,): it looks along +y, so that x runs to the right."""
        back = self.distance * math.cos(ELEVATION)
        up = self.distance * math.sin(ELEVATION)
        return np.array([self.target[0], self.target[1] - back, up])

    @property
    def focal_length(self) -> float:
        """Its focal length [pixel]."""
        return 0.5 * self.height / math.tan(0.5 * FIELD_OF_VIEW)

    def depth(self, points: Array) -> Array:
        """Return how far points are in front of the camera [m].

        Args:
            points: In the world [m], (..., 3).
        """
        return self._seen(points)[..., 2]

    def project(self, points: Array) -> Array:
        """Return where points in front of the camera are in the picture.

        Args:
            points: In the world [m], (..., 3).

        Returns:
            To the right and down from the upper left corner [pixel], (..., 2).
        """
        seen = self._seen(points)
        scale = self.focal_length / np.maximum(seen[..., 2:], NEAR)
        pixels: Array = seen[..., :2] * scale + (0.5 * self.width, 0.5 * self.height)
        return pixels

    def metre(self, point: Array) -> float:
        """Return how long a metre across the view is at a point of the world [pixel]."""
        return self.focal_length / max(float(self.depth(point)), NEAR)

    @property
    def horizon(self) -> float:
        """How far down in the picture the ground ends [pixel]; negative if it fills it."""
        return 0.5 * self.height - self.focal_length * math.tan(ELEVATION)

    def _seen(self, points: Array) -> Array:
        """Return points in the camera's frame: right, down, ahead [m]."""
        c, s = math.cos(ELEVATION), math.sin(ELEVATION)
        axes = np.array([[1.0, 0.0, 0.0], [0.0, -s, -c], [0.0, c, -s]])
        seen: Array = (points - self.position) @ axes.T
        return seen


def cut_in_front(camera: Camera, points: Array) -> Array:
    """Return the part of a convex polygon that lies in front of the camera.

    Args:
        camera: The camera.
        points: Its corners in the world [m], (n, 3).

    Returns:
        Corners [m], (m, 3); none if all of it is behind.
    """
    depth = camera.depth(points) - NEAR
    kept = []
    for k in range(len(points)):
        a, b = points[k - 1], points[k]
        da, db = float(depth[k - 1]), float(depth[k])
        if (da > 0.0) != (db > 0.0):
            kept.append(a + (b - a) * da / (da - db))
        if db > 0.0:
            kept.append(b)
    return np.array(kept).reshape(-1, 3)
