"""The bodies of a snapshot as surfaces: A1s, bases without legs, cylinders."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.palette import OBSTACLE, Colour, lighter, robot_colour
from layered_cbf_ros.viewing.robot_shape import RobotShape
from layered_cbf_ros.viewing.sight.snapshot import RobotSight, Snapshot
from layered_cbf_ros.viewing.solids import Mesh, cylinder, nose, thinned
from layered_cbf_ros.viewing.video.shading import Facets, facets

CELL = 0.018
"""Detail of an A1 that is drawn [m]: about a pixel of a picture in which it is well seen."""
DISC_HEIGHT = 0.3  # of a robot without legs [m]
NOSE_HEIGHT = 0.02
LEGS: Colour = (88, 92, 99)
FEET: Colour = (40, 42, 46)
WHITE: Colour = (255, 255, 255)


class Bodies:
    """Turns snapshots into surfaces; keeps only the meshes."""

    def __init__(self) -> None:
        """Read the meshes.

        Raises:
            ParameterError: If the description of the robot is absent.
        """
        self._shape = RobotShape()
        self._parts = [
            (part.name, facets(thinned(part.mesh, CELL), FEET if part.name == 'toe' else LEGS))
            for part in self._shape.parts
        ]

    def of(self, snapshot: Snapshot) -> list[Facets]:
        """Return the surfaces of all bodies, in the world."""
        surfaces: list[Facets] = []
        for place, robot in enumerate(snapshot.robots):
            colour = robot_colour(place)
            surfaces += self._legged(robot, colour) if robot.has_legs else _base(robot, colour)
        for thing in snapshot.obstacles:
            body = _scaled(cylinder(), thing.radius, thing.height)
            surfaces.append(facets(body, OBSTACLE).placed(np.eye(3), _lifted(thing.position, 0.0)))
        return surfaces

    def _legged(self, robot: RobotSight, colour: Colour) -> list[Facets]:
        surfaces = []
        poses = self._shape.poses([robot.configuration])
        for (name, body), (positions, turns) in zip(self._parts, poses, strict=True):
            part = body.painted(lighter(colour, 0.2)) if name == 'trunk' else body
            for position, (w, x, y, z) in zip(positions, turns, strict=True):
                surfaces.append(part.placed(pin.Quaternion(w, x, y, z).matrix(), position))
        return surfaces


def _base(robot: RobotSight, colour: Colour) -> list[Facets]:
    """Return a robot without legs: a disc, and an arrowhead on it that points ahead."""
    turn = pin.Quaternion(robot.configuration[3:7]).matrix()
    disc = facets(_scaled(cylinder(), robot.radius, DISC_HEIGHT), lighter(colour, 0.2))
    ahead = facets(_scaled(nose(), 0.8 * robot.radius, NOSE_HEIGHT), WHITE)
    centre = robot.configuration[:2]
    return [
        disc.placed(turn, _lifted(centre, 0.0)),
        ahead.placed(turn, _lifted(centre, DISC_HEIGHT)),
    ]


def _scaled(mesh: Mesh, radius: float, height: float) -> Mesh:
    return Mesh(mesh.vertices * (radius, radius, height), mesh.faces)


def _lifted(point: Array, height: float) -> Array:
    return np.array([point[0], point[1], height])
