"""Bodies as shaded triangles, the farthest first, and the shadows they throw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.palette import Colour
from layered_cbf_ros.viewing.solids import Mesh
from layered_cbf_ros.viewing.video.camera import NEAR, Camera

TO_LIGHT = np.array([-0.35, -0.5, 0.79])
AMBIENT = 0.45
SHADOW = 70  # how dark it is, of 255
SHADOW_COLOUR = (30, 34, 42)


@dataclass(frozen=True, slots=True)
class Facets:
    """Triangles of a surface.

    Attributes:
        corners: Anticlockwise seen from outside [m], (n, 3, 3).
        normals: Unit normals, outwards, (n, 3).
        colours: Red, green, blue of 255, (n, 3).
    """

    corners: Array
    normals: Array
    colours: NDArray[np.uint8]

    def placed(self, rotation: Array, translation: Array) -> Facets:
        """Return the same surface, turned (3, 3) and then moved (3,) [m]."""
        corners = self.corners @ rotation.T + translation
        return Facets(corners, self.normals @ rotation.T, self.colours)

    def painted(self, colour: Colour) -> Facets:
        """Return the same surface in one colour."""
        paint = np.tile(np.array(colour, dtype=np.uint8), (len(self.corners), 1))
        return Facets(self.corners, self.normals, paint)


def facets(mesh: Mesh, colour: Colour) -> Facets:
    """Return the surface of a mesh in one colour."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    return Facets(corners, normals, np.tile(np.array(colour, dtype=np.uint8), (len(corners), 1)))


def draw_solids(draw: ImageDraw.ImageDraw, camera: Camera, bodies: list[Facets]) -> None:
    """Draw what faces the camera, the farthest first."""
    outlines, shades, depths = [], [], []
    for body in bodies:
        middle = body.corners.mean(axis=1)
        shown = np.einsum('ij,ij->i', camera.position - middle, body.normals) > 0.0
        shown &= camera.depth(body.corners).min(axis=1) > NEAR
        light = AMBIENT + (1.0 - AMBIENT) * np.maximum(body.normals[shown] @ TO_LIGHT, 0.0)
        outlines += _outlines(camera, body.corners[shown])
        shades += np.minimum(body.colours[shown] * light[:, None], 255.0).astype(int).tolist()
        depths.append(camera.depth(middle[shown]))
    if not depths:
        return
    for k in np.argsort(-np.concatenate(depths)).tolist():
        draw.polygon(outlines[k], fill=tuple(shades[k]))


def draw_shadows(canvas: Image.Image, camera: Camera, bodies: list[Facets]) -> None:
    """Darken the ground where bodies keep the light away; overlaps darken it once."""
    mask = Image.new('L', canvas.size, 0)
    draw = ImageDraw.Draw(mask)
    for body in bodies:
        corners = body.corners[body.normals @ TO_LIGHT > 0.0]  # these throw the whole shadow
        fallen = corners - corners[..., 2:] * (TO_LIGHT / TO_LIGHT[2])
        for outline in _outlines(camera, fallen[camera.depth(fallen).min(axis=1) > NEAR]):
            draw.polygon(outline, fill=SHADOW)
    box = mask.getbbox()
    if box is not None:
        canvas.paste(SHADOW_COLOUR, box, mask.crop(box))


def _outlines(camera: Camera, corners: Array) -> list[list[float]]:
    """Return the corners of each triangle in the picture, one after the other [pixel]."""
    pixels = camera.project(corners)
    return pixels.reshape(len(corners), 6).tolist()
