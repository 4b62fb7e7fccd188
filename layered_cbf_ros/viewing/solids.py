"""Small triangle meshes: surfaces of revolution, and meshes that are thinned for a phone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import Array


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles; seen from outside their corners run counterclockwise.

    Attributes:
        vertices: [m], (v, 3).
        faces: Indices of vertices, (f, 3).
    """

    vertices: Array
    faces: NDArray[np.uint32]


def revolved(profile: list[tuple[float, float]], sides: int = 24) -> Mesh:
    """Return the surface that a profile sweeps around the z axis.

    Args:
        profile: Points (distance from the axis, z) [m], from the lowest to the highest.
        sides: Flat sides around the axis.
    """
    angles = np.arange(sides) * (math.tau / sides)
    around = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(sides)))
    rings = [r * around + (0.0, 0.0, z) for r, z in profile]
    this = np.arange(sides)
    following = (this + 1) % sides
    faces = []
    for low in range(len(profile) - 1):
        a, b = low * sides + this, low * sides + following
        c, d = a + sides, b + sides
        faces += [np.column_stack((a, b, d)), np.column_stack((a, d, c))]
    return _without_empty_faces(Mesh(np.concatenate(rings), np.concatenate(faces)))


def sphere(bands: int = 10, sides: int = 20) -> Mesh:
    """Return the unit sphere."""
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, bands + 1)
    profile = [(max(0.0, math.cos(a)), math.sin(a)) for a in angles]
    profile[0], profile[-1] = (0.0, -1.0), (0.0, 1.0)
    return revolved(profile, sides)


def cylinder(sides: int = 40) -> Mesh:
    """Return a cylinder of radius 1 from z = 0 to 1, its edge slightly rounded."""
    return revolved(
        [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 0.97), (0.97, 1.0), (0.97, 1.0), (0.0, 1.0)],
        sides,
    )


def nose(sides: int = 3) -> Mesh:
    """Return a flat arrowhead of length 1 along x: it shows where a disc is heading."""
    corners = np.array([(1.0, 0.0), (-0.4, 0.6), (-0.4, -0.6)])
    low, high = (np.column_stack((corners, np.full(sides, z))) for z in (0.0, 1.0))
    this = np.arange(sides)
    following = (this + 1) % sides
    flanks = [
        np.column_stack((this, following, following + sides)),
        np.column_stack((this, following + sides, this + sides)),
    ]
    caps = np.array([(0, 2, 1), (3, 4, 5)])
    faces = np.concatenate((*flanks, caps)).astype(np.uint32)
    return Mesh(np.concatenate((low, high)), faces)


def thinned(mesh: Mesh, cell: float) -> Mesh:
    """Return a mesh with one vertex, their mean, for all in each cube of a grid.

    Args:
        mesh: Any mesh.
        cell: Edge of the cubes: finer detail is lost [m].
    """
    cubes = np.floor(mesh.vertices / cell).astype(np.int64)
    _, cube, counts = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
    cube = cube.ravel()
    vertices = np.zeros((len(counts), 3))
    np.add.at(vertices, cube, mesh.vertices)
    vertices /= counts[:, None]
    return _without_empty_faces(Mesh(vertices, cube[mesh.faces].astype(np.uint32)))


def _without_empty_faces(mesh: Mesh) -> Mesh:
    """Leave out triangles without an area, and those that are there twice."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    faces = mesh.faces[area > 1e-12]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return Mesh(mesh.vertices, faces[np.sort(kept)].astype(np.uint32))
