"""Bodies that a robot must not touch, and how far it is from them at least, or exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import coal
import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.body_geometry import BodyGeometry
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Obstacle, Wall

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Solid:
    """One shape in the world.

    Attributes:
        shape, pose: As coal has them.
        radius: No part is farther from the shape's origin [m]; infinite if not known.
    """

    shape: coal.CollisionGeometry
    pose: coal.Transform3s
    radius: float = float('inf')


class Other(Protocol):
    """The other one of a pair; rows are numbers of samples."""

    def coarse(self, bases: Array, reach: Array) -> Array:
        """Return a lower bound of the distance at every sample [m], (k,).

        Args:
            bases: Of the robot, world [m], (k, 3).
            reach: How far its parts are from its base at most [m], (k,).
        """
        ...

    def fine(self, rows: Rows, centres: Array, radii: Array) -> Array:
        """Return a lower bound for each covering sphere of the robot [m], (rows, S).

        Args:
            rows: Samples.
            centres: Of the robot's covering spheres [m], (rows, S, 3).
            radii: Of these [m], (S,).
        """
        ...

    def solids(self, row: int) -> list[Solid]:
        """Return the shapes of the body at a sample."""
        ...


@dataclass(frozen=True, slots=True)
class RobotBody:
    """A robot.

    Attributes:
        geometry: Its shapes.
        configurations: At every sample, (k, 19).
        reach: How far its parts are from its base at most [m], (k,).
    """

    geometry: BodyGeometry
    configurations: Array
    reach: Array

    def coarse(self, bases: Array, reach: Array) -> Array:
        """Return the distance of two balls around the bases."""
        apart: Array = np.linalg.norm(bases - self.configurations[:, :3], axis=1)
        return apart - reach - self.reach

    def fine(self, rows: Rows, centres: Array, radii: Array) -> Array:
        """Return the distance of each sphere from the nearest one of this robot."""
        own = self.geometry.cover_centres(self.configurations[rows])
        origin = own[:, :1]  # near them, so that no digits are lost in the squares
        a, b = centres - origin, own - origin
        squares = (a * a).sum(axis=2)[:, :, None] + (b * b).sum(axis=2)[:, None, :]
        squares -= 2.0 * a @ b.transpose(0, 2, 1)
        distances = np.sqrt(np.maximum(squares, 0.0)) - self.geometry.cover.radius
        nearest: Array = distances.min(axis=2) - radii
        return nearest

    def solids(self, row: int) -> list[Solid]:
        """Return its shapes."""
        poses = self.geometry.placements(self.configurations[row])
        shapes = zip(self.geometry.shapes, poses, self.geometry.radii, strict=True)
        return [Solid(shape, pose, radius) for shape, pose, radius in shapes]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An obstacle: an upright cylinder on the ground.

    Attributes:
        obstacle: Its size.
        positions: Centre in the plane at every sample [m], (k, 2).
    """

    obstacle: Obstacle
    positions: Array

    def coarse(self, bases: Array, reach: Array) -> Array:
        """Return the distance in the plane."""
        apart: Array = np.linalg.norm(bases[:, :2] - self.positions, axis=1)
        return apart - reach - self.obstacle.radius

    def fine(self, rows: Rows, centres: Array, radii: Array) -> Array:
        """Return the distance in the plane of each sphere."""
        apart: Array = np.linalg.norm(centres[:, :, :2] - self.positions[rows, None], axis=2)
        return apart - radii - self.obstacle.radius

    def solids(self, row: int) -> list[Solid]:
        """Return the cylinder."""
        height = self.obstacle.height
        pose = coal.Transform3s(np.eye(3), np.array([*self.positions[row], 0.5 * height]))
        return [Solid(coal.Cylinder(self.obstacle.radius, height), pose)]


@dataclass(frozen=True, slots=True)
class HalfSpace:
    """A wall: all that lies behind its surface is solid."""

    wall: Wall

    def coarse(self, bases: Array, reach: Array) -> Array:
        """Return the distance along the normal."""
        return (bases[:, :2] - self.wall.point) @ np.array(self.wall.normal) - reach

    def fine(self, rows: Rows, centres: Array, radii: Array) -> Array:
        """Return the distance along the normal of each sphere."""
        return (centres[:, :, :2] - self.wall.point) @ np.array(self.wall.normal) - radii

    def solids(self, row: int) -> list[Solid]:
        """Return the half-space n . x <= n . p."""
        normal = np.array([*self.wall.normal, 0.0])
        offset = float(normal[:2] @ self.wall.point)
        return [Solid(coal.Halfspace(normal, offset), coal.Transform3s.Identity())]
