"""The robot's description as it is published: mesh paths that every tool can follow."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.robot_model import find_urdf


def robot_description() -> str:
    """Return the A1's URDF with absolute `file://` addresses of its meshes.

    In the file they are relative to its folder, which who gets the text doesn't know.

    Raises:
        ParameterError: If the description is absent, or a mesh it names.
    """
    path = find_urdf()
    tree = ElementTree.parse(path)
    for mesh in tree.iter('mesh'):
        place = path.parent / mesh.get('filename', '')
        if not place.is_file():
            raise ParameterError(f'robot model: {place} is absent; install pybullet 3.2.7')
        mesh.set('filename', place.resolve().as_uri())
    return ElementTree.tostring(tree.getroot(), encoding='unicode')
