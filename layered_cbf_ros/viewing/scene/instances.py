"""Many copies of one mesh, or many arrows or lines, that move: cheap to send, cheap to draw."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.scene.colours import Colours
from layered_cbf_ros.viewing.solids import Mesh

UPRIGHT = (1.0, 0.0, 0.0, 0.0)  # quaternion w, x, y, z


class Instances:
    """Copies of one mesh; how many there are may change."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        mesh: Mesh,
        opacity: float | None = None,
        casts_shadow: bool = True,
        is_flat: bool = False,
    ) -> None:
        self._scene, self._name = scene, name
        self._vertices = mesh.vertices.astype(np.float32)
        self._faces = mesh.faces
        self._look: dict[str, Any] = {
            'opacity': opacity,
            'cast_shadow': casts_shadow,
            'receive_shadow': casts_shadow,
            'flat_shading': is_flat,
            'lod': 'off',
        }
        self._handle: viser.BatchedMeshHandle | None = None
        self._count = 0
        self.visible = True

    def place(
        self,
        positions: Array,
        colours: Colours,
        orientations: Array | None = None,
        scales: Array | None = None,
    ) -> None:
        """Put the copies where they are now.

        Args:
            positions: In the world [m], (n, 3).
            colours: (n, 3).
            orientations: Quaternions w, x, y, z, (n, 4); None: upright.
            scales: Of the mesh's axes, (n, 3); None: as it is.
        """
        count = len(positions)
        if orientations is None:
            orientations = np.tile(UPRIGHT, (count, 1))
        if scales is None:
            scales = np.ones((count, 3))
        if self._handle is None or count != self._count:
            self._make(positions, colours, orientations, scales)
        handle = self._handle
        if handle is None:
            return
        handle.batched_positions = positions.astype(np.float32)
        handle.batched_wxyzs = orientations.astype(np.float32)
        handle.batched_scales = scales.astype(np.float32)
        handle.batched_colors = colours
        handle.visible = self.visible

    def _make(self, positions: Array, colours: Colours, orientations: Array, scales: Array) -> None:
        """Make the copies anew: there are more of them, or fewer."""
        if self._handle is not None:
            self._handle.remove()
        self._handle, self._count = None, len(positions)
        if self._count:
            self._handle = self._scene.add_batched_meshes_simple(
                self._name,
                self._vertices,
                self._faces,
                batched_wxyzs=orientations,
                batched_positions=positions,
                batched_scales=scales,
                batched_colors=colours,
                **self._look,
            )


class Arrows:
    """Arrows of one colour each."""

    SHORTEST = 0.02
    """Shorter ones aren't seen: their direction tells nothing [m]."""

    BURIED = np.array([[0.0, 0.0, -2.0], [0.0, 0.0, -1.9]])
    """Where those are meanwhile: to make arrows anew costs more than to move them [m]."""

    def __init__(self, scene: viser.SceneApi, name: str, shaft: float) -> None:
        """Make a place for them.

        Args:
            scene: Where they are drawn.
            name: Of the node.
            shaft: Radius of a shaft [m].
        """
        self._scene, self._name = scene, name
        self._shaft = shaft
        self._handle: viser.ArrowsHandle | None = None
        self.visible = True

    def place(self, tails: Array, tips: Array, colours: Colours) -> None:
        """Put the arrows where they are now.

        Args:
            tails, tips: In the world [m], (n, 3) each.
            colours: (n, 3).
        """
        points = np.stack((tails, tips), axis=1)
        points[np.linalg.norm(tips - tails, axis=1) < self.SHORTEST] = self.BURIED
        if self._handle is None or len(points) != len(self._handle.points):
            if self._handle is not None:
                self._handle.remove()
            self._handle = None
            if len(points):
                self._handle = self._scene.add_arrows(
                    self._name,
                    points,
                    colours,
                    shaft_radius=self._shaft,
                    head_radius=2.6 * self._shaft,
                    head_length=5.0 * self._shaft,
                )
        if self._handle is not None:
            self._handle.points = points.astype(np.float32)
            self._handle.colors = colours
            self._handle.visible = self.visible


class Lines:
    """Pieces of lines; how many there are may change."""

    def __init__(self, scene: viser.SceneApi, name: str, thickness: float) -> None:
        self._scene, self._name, self._thickness = scene, name, thickness
        self._handle: viser.LineSegmentsHandle | None = None
        self.visible = True

    def place(self, pieces: Array, colours: Colours) -> None:
        """Put the lines where they are now.

        Args:
            pieces: Both ends of each piece [m], (n, 2, 3).
            colours: Of each piece, (n, 3).
        """
        points, both_ends = pieces.astype(np.float32), np.repeat(colours[:, None], 2, axis=1)
        if self._handle is None or len(points) != len(self._handle.points):
            if self._handle is not None:
                self._handle.remove()
            self._handle = None
            if len(points):
                self._handle = self._scene.add_line_segments(
                    self._name, points, both_ends, thickness=self._thickness
                )
        if self._handle is not None:
            self._handle.points = points
            self._handle.colors = both_ends
            self._handle.visible = self.visible
