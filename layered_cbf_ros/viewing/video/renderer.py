"""Draws snapshots of a run as pictures, on the processor alone: no display, no graphics card."""

from __future__ import annotations

from PIL import Image, ImageDraw

from layered_cbf_ros.viewing.history import History
from layered_cbf_ros.viewing.palette import (
    DESIRED,
    FLOOR,
    OBSTACLE,
    SKY,
    barrier_colour,
    robot_colour,
)
from layered_cbf_ros.viewing.sight.snapshot import Snapshot
from layered_cbf_ros.viewing.video.bodies import Bodies
from layered_cbf_ros.viewing.video.camera import Camera
from layered_cbf_ros.viewing.video.frame import Frame
from layered_cbf_ros.viewing.video.ground import Ground
from layered_cbf_ros.viewing.video.shading import draw_shadows, draw_solids
from layered_cbf_ros.viewing.video.words import Words

OVERSAMPLING = 2
SHOWN_H = 1.5  # balls of pairs that are safer are left out [m]


class Renderer:
    """Draws one snapshot after the other; keeps only meshes and fonts."""

    def __init__(self) -> None:
        """Read the meshes.

        Raises:
            ParameterError: If the description of the robot is absent.
        """
        self._bodies = Bodies()

    def draw(self, frame: Frame) -> Image.Image:
        """Return the picture of a frame."""
        snapshot, camera = frame.snapshot, frame.camera
        size = camera.width * OVERSAMPLING, camera.height * OVERSAMPLING
        large = Camera(camera.target, camera.distance, *size)
        canvas = Image.new('RGB', size, FLOOR)
        draw = ImageDraw.Draw(canvas, 'RGBA')
        ground = Ground(draw, large, OVERSAMPLING * camera.height / 720.0)
        _draw_flat(ground, snapshot, frame.history)
        if large.horizon > 0.0:
            draw.rectangle((0, 0, size[0], large.horizon), fill=SKY)
        bodies = self._bodies.of(snapshot)
        draw_shadows(canvas, large, bodies)
        _draw_arrows(ground, snapshot)
        draw_solids(draw, large, bodies)
        picture = canvas.reduce(OVERSAMPLING)
        Words(picture, camera).write(frame)
        return picture


def _draw_flat(ground: Ground, snapshot: Snapshot, history: History) -> None:
    """Draw all that bodies stand upon."""
    ground.grid()
    for wall in snapshot.walls:
        ground.wall(wall)
    for place, robot in enumerate(snapshot.robots):
        ground.disc(robot.reach[:2], float(robot.reach[2]), robot_colour(place), 42, 120)
    for ball in snapshot.balls:
        if ball.h < SHOWN_H:
            strength = 1.0 - max(ball.h, 0.0) / SHOWN_H
            colour = barrier_colour(ball.h)
            ground.disc(ball.centre, ball.radius, colour, round(110 * strength), 0)
            ground.dashed_circle(ball.centre, ball.radius, colour, round(90 + 165 * strength))
    for place, robot in enumerate(snapshot.robots):
        ground.trail(history.trail(robot.name), robot_colour(place))


def _draw_arrows(ground: Ground, snapshot: Snapshot) -> None:
    """Draw what each robot wants to do, and what it may do."""
    for place, robot in enumerate(snapshot.robots):
        start = robot.configuration[:2]
        ground.arrow(start, robot.target, DESIRED, 200, 5.0)
        if robot.plan is not None:
            ground.arrow(start, robot.plan.velocity, robot_colour(place), 255, 3.0)
    for thing in snapshot.obstacles:
        ground.arrow(thing.position, thing.velocity, OBSTACLE, 220, 3.0)
