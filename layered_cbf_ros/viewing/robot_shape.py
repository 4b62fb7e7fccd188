"""What an A1 looks like: the visible parts of its description, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.robot_model import find_urdf
from layered_cbf_ros.viewing.solids import Mesh, sphere, thinned

CELL = 0.006
"""Detail of the description's meshes that is shown [m]: 48,000 triangles become 12,000."""


@dataclass(frozen=True, slots=True)
class Part:
    """One mesh and where a robot has it.

    Attributes:
        name: `trunk`, `hip`, `thigh`, ...
        mesh: In its own frame.
        places: Which of the shapes of a robot have this mesh.
    """

    name: str
    mesh: Mesh
    places: tuple[int, ...]


class RobotShape:
    """The visible parts of all robots of a team: they look alike.

    Attributes:
        parts: One for each different mesh.
    """

    def __init__(self) -> None:
        """Read the description and its meshes.

        Raises:
            ParameterError: If the description is absent.
        """
        path = find_urdf()
        self._model = model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
        self._data = model.createData()
        self._geometry = pin.buildGeomFromUrdf(
            model, str(path), pin.GeometryType.VISUAL, package_dirs=str(path.parent)
        )
        self._placed = self._geometry.createData()
        shapes: dict[str, tuple[Mesh, list[int]]] = {}
        for i, thing in enumerate(self._geometry.geometryObjects):
            name, mesh = _visible(thing)
            if mesh is not None:
                shapes.setdefault(name, (mesh, []))[1].append(i)
        self.parts = tuple(Part(name, mesh, tuple(i)) for name, (mesh, i) in shapes.items())

    def poses(self, configurations: Sequence[Array]) -> list[tuple[Array, Array]]:
        """Return where each part is, for some robots at once.

        Args:
            configurations: Of each robot, as in RobotState, (19,) each.

        Returns:
            For each part its positions [m] (n, 3) and orientations w, x, y, z (n, 4) in
            the world, those of the first robot first.
        """
        count = len(self._geometry.geometryObjects)
        placed = np.empty((len(configurations), count, 7))  # there may be no robot with legs
        for row, configuration in zip(placed, configurations, strict=True):
            row[:] = self._placements(configuration)
        poses = []
        for part in self.parts:
            rows = placed[:, list(part.places)].reshape(-1, 7)
            poses.append((rows[:, :3], rows[:, [6, 3, 4, 5]]))
        return poses

    def _placements(self, configuration: Array) -> Array:
        """Return position and quaternion x, y, z, w of every shape of one robot, (k, 7)."""
        pin.forwardKinematics(self._model, self._data, configuration)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed)
        return np.array([pin.SE3ToXYZQUAT(place) for place in self._placed.oMg])


def _visible(thing: pin.GeometryObject) -> tuple[str, Mesh | None]:
    """Return the name and mesh of a shape; no mesh if it only marks a frame."""
    shape = thing.geometry
    if isinstance(shape, coal.Sphere):
        ball = sphere(6, 12)
        return 'toe', Mesh(shape.radius * ball.vertices, ball.faces)
    if not isinstance(shape, coal.BVHModelBase):
        return thing.name, None
    triangles = (shape.tri_indices(k) for k in range(shape.num_tris))
    faces = np.array([(t[0], t[1], t[2]) for t in triangles], dtype=np.uint32)
    vertices = np.array(shape.vertices()) * np.asarray(thing.meshScale)
    return Path(thing.meshPath).stem, thinned(Mesh(vertices, faces), CELL)
