"""The world in the 3D scene: ground, light, walls, obstacles with the arrows of their velocity."""

from __future__ import annotations

import math

import numpy as np
import viser

from layered_cbf_ros.scenario import Wall
from layered_cbf_ros.viewing.palette import lighter
from layered_cbf_ros.viewing.scene.colours import GROUND, OBSTACLE, OBSTACLE_ARROW, WALL
from layered_cbf_ros.viewing.scene.instances import Arrows, Instances
from layered_cbf_ros.viewing.scene.robots import as_colours
from layered_cbf_ros.viewing.sight.snapshot import Snapshot
from layered_cbf_ros.viewing.solids import cylinder

WALL_HEIGHT, WALL_LENGTH, WALL_THICKNESS = 0.35, 60.0, 0.06
AHEAD = 1.0
"""An arrow shows how far an obstacle gets in this time [s]."""


def build_ground(scene: viser.SceneApi) -> None:
    """Lay a light grid of 1 m, and light it."""
    scene.set_up_direction('+z')
    scene.add_grid(
        '/ground',
        plane='xy',
        infinite_grid=True,
        cell_size=0.5,
        cell_thickness=0.6,
        cell_color=(226, 229, 234),
        section_size=1.0,
        section_thickness=0.9,
        section_color=(204, 209, 217),
        plane_color=GROUND,
        plane_opacity=1.0,
        fade_distance=45.0,
        shadow_opacity=0.28,
        position=(0.0, 0.0, -0.001),
    )
    scene.configure_environment_map(None)
    scene.configure_default_lights(False)
    scene.add_light_hemisphere(
        '/lights/sky', sky_color=(255, 255, 255), ground_color=(176, 180, 190), intensity=1.1
    )
    scene.add_light_directional(
        '/lights/sun', intensity=1.3, cast_shadow=True, position=(-4.0, -6.0, 10.0)
    )


def build_wall(scene: viser.SceneApi, wall: Wall, middle: tuple[float, float]) -> None:
    """Stand up a wall, on its forbidden side.

    Args:
        scene: Where.
        wall: A half-plane: it has no end, so a long piece is drawn.
        middle: What the drawn piece is nearest to [m].
    """
    normal, along = np.array(wall.normal), np.array([-wall.normal[1], wall.normal[0]])
    offset = np.subtract(middle, wall.point) @ along
    centre = np.array(wall.point) + offset * along - 0.5 * WALL_THICKNESS * normal
    yaw = math.atan2(along[1], along[0])
    scene.add_box(
        f'/walls/{wall.name}',
        WALL,
        (WALL_LENGTH, WALL_THICKNESS, WALL_HEIGHT),
        opacity=0.55,
        position=(centre[0], centre[1], 0.5 * WALL_HEIGHT),
        wxyz=(math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)),
        cast_shadow=False,
    )


class ObstacleLayer:
    """Obstacles as cylinders; paler where they are only tracked."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._bodies = Instances(scene, '/obstacles/bodies', cylinder())
        self._arrows = Arrows(scene, '/obstacles/velocities', 0.025)

    def draw(self, snapshot: Snapshot) -> None:
        """Draw the obstacles of an instant."""
        obstacles = snapshot.obstacles
        ground = np.array([[*o.position, 0.0] for o in obstacles]).reshape(-1, 3)
        scales = np.array([[o.radius, o.radius, o.height] for o in obstacles]).reshape(-1, 3)
        pale = lighter(OBSTACLE, 0.45)
        colours = as_colours([pale if o.is_tracked else OBSTACLE for o in obstacles])
        self._bodies.place(ground, colours, scales=scales)
        tails = ground + np.column_stack((*np.zeros((2, len(ground))), scales[:, 2] + 0.06))
        steps = np.array([[*(AHEAD * o.velocity), 0.0] for o in obstacles]).reshape(-1, 3)
        self._arrows.place(tails, tails + steps, as_colours([OBSTACLE_ARROW] * len(tails)))
