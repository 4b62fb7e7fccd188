"""The robots in the 3D scene: bodies with legs, discs with a heading, names, foot forces."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import viser

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.palette import Colour, lighter, robot_colour
from layered_cbf_ros.viewing.robot_shape import RobotShape
from layered_cbf_ros.viewing.scene.colours import FEET, FORCE, LEGS, Colours
from layered_cbf_ros.viewing.scene.instances import Arrows, Instances
from layered_cbf_ros.viewing.sight.snapshot import RobotSight, Snapshot
from layered_cbf_ros.viewing.solids import cylinder, nose

METRES_A_NEWTON = 0.004
DISC_HEIGHT = 0.22
"""Of a robot without legs [m]."""
LABEL_HEIGHT = 0.28
"""Of a name above the base [m]."""


class RobotLayer:
    """All robots of a team; the ones that have legs as their description tells."""

    def __init__(self, scene: viser.SceneApi, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._shape = RobotShape()
        self._parts = [
            Instances(scene, f'/robots/{part.name}', part.mesh) for part in self._shape.parts
        ]
        self._discs = Instances(scene, '/robots/discs', cylinder())
        self._noses = Instances(scene, '/robots/noses', nose(), is_flat=True)
        self._labels = {
            name: scene.add_label(
                f'/labels/{name}', name, anchor='bottom-center', font_screen_scale=0.8
            )
            for name in names
        }

    def draw(self, snapshot: Snapshot) -> None:
        """Draw the robots of an instant."""
        walking = [robot for robot in snapshot.robots if robot.has_legs]
        rolling = [robot for robot in snapshot.robots if not robot.has_legs]
        self._draw_bodies(walking)
        self._draw_discs(rolling)
        for robot in snapshot.robots:
            label = self._labels[robot.name]
            label.position = robot.configuration[:3] + np.array([0.0, 0.0, LABEL_HEIGHT])
            label.text = f'{robot.name} · {_doing(robot)}' if _doing(robot) else robot.name

    def show_labels(self, wanted: bool) -> None:
        """Show or hide the names."""
        for label in self._labels.values():
            label.visible = wanted

    def _draw_bodies(self, robots: Sequence[RobotSight]) -> None:
        poses = self._shape.poses([robot.configuration for robot in robots])
        for part, instances, (positions, orientations) in zip(
            self._shape.parts, self._parts, poses, strict=True
        ):
            colours = [self._colour(part.name, robot) for robot in robots]
            each = np.repeat(as_colours(colours), len(part.places), axis=0)
            instances.place(positions, each, orientations)

    def _draw_discs(self, robots: Sequence[RobotSight]) -> None:
        colours = [robot_colour(self._names.index(robot.name)) for robot in robots]
        ground = np.array([[*r.configuration[:2], 0.0] for r in robots]).reshape(-1, 3)
        radii = np.array([r.radius for r in robots])
        height = np.full(len(robots), DISC_HEIGHT)
        self._discs.place(
            ground, as_colours(colours), scales=np.column_stack((radii, radii, height))
        )
        turned = np.array([yaw_quaternion(r.configuration) for r in robots]).reshape(-1, 4)
        sizes = np.column_stack((0.6 * radii, 0.6 * radii, 0.1 * height))
        bright = as_colours([lighter(colour, 0.8) for colour in colours])
        self._noses.place(ground + np.array([0.0, 0.0, DISC_HEIGHT]), bright, turned, sizes)

    def _colour(self, part: str, robot: RobotSight) -> Colour:
        if part == 'trunk':
            return robot_colour(self._names.index(robot.name))
        return FEET if part == 'toe' else LEGS


class ForceLayer:
    """The planned ground reaction forces, as arrows that end in the toes."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._arrows = Arrows(scene, '/forces', 0.012)

    @property
    def visible(self) -> bool:
        """Return whether they are drawn."""
        return self._arrows.visible

    @visible.setter
    def visible(self, wanted: bool) -> None:
        self._arrows.visible = wanted

    def draw(self, snapshot: Snapshot) -> None:
        """Draw the forces of an instant; nobody without legs has any."""
        walking = [robot for robot in snapshot.robots if robot.has_legs]
        toes = np.array([r.foot_positions for r in walking]).reshape(-1, 3)
        forces = np.array([r.foot_forces for r in walking]).reshape(-1, 3)
        colours = as_colours([FORCE] * len(toes))
        self._arrows.place(toes, toes + METRES_A_NEWTON * forces, colours)


def as_colours(colours: Sequence[Colour]) -> Colours:
    """Return colours as an array, (n, 3)."""
    return np.array(colours, dtype=np.uint8).reshape(-1, 3)


def yaw_quaternion(configuration: Array) -> tuple[float, float, float, float]:
    """Return the heading alone of a configuration, as w, x, y, z."""
    x, y, z, w = configuration[3:7]
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)


def _doing(robot: RobotSight) -> str:
    """Return what is special about a robot now, in a word."""
    if robot.is_held:
        return 'held'
    return 'steered' if robot.is_steered else ''
