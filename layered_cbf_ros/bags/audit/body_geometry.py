"""Where the parts of an A1 are: for many states at once in numpy, for one by pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import coal
import numpy as np
import pinocchio as pin

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.robot_model import find_urdf

FREE_FLYER = 7
"""Entries of a configuration before the joints: position and quaternion."""

SPHERES_A_BOX = 4
"""Spheres that cover a box along its longest side: one alone would be far too large."""


@dataclass(frozen=True, slots=True)
class Cover:
    """Spheres that together contain the whole body.

    Attributes:
        joint: Joint that each moves with; 1 is the trunk, (S,).
        centre: In the frame of that joint [m], (S, 3).
        radius: [m], (S,).
    """

    joint: Array
    centre: Array
    radius: Array


class BodyGeometry:
    """Kinematics and collision shapes of the robot description.

    Attributes:
        cover: Spheres around all shapes.
        shapes: The shapes themselves, as coal has them.
        radii: No part of a shape is farther from its origin [m].
        lower, upper: Range of each joint in the description [rad], (12,).
    """

    def __init__(self) -> None:
        path = str(find_urdf())
        self._model = model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
        self._data = model.createData()
        self._geometry = pin.buildGeomFromUrdf(model, path, pin.GeometryType.COLLISION)
        self._placed = self._geometry.createData()
        objects = self._geometry.geometryObjects
        self.shapes = [thing.geometry for thing in objects]
        self.radii = [_radius(shape) for shape in self.shapes]
        self.cover = _cover(objects)
        self.lower = np.array(model.lowerPositionLimit[FREE_FLYER:])
        self.upper = np.array(model.upperPositionLimit[FREE_FLYER:])
        self._axes = [_axis(model.joints[j]) for j in range(2, model.njoints)]
        self._parents = list(model.parents)
        self._offsets = [np.array(placement.translation) for placement in model.jointPlacements]
        self._turns = [np.array(placement.rotation) for placement in model.jointPlacements]
        masses = np.array([inertia.mass for inertia in model.inertias])
        levers = np.array([inertia.lever for inertia in model.inertias])
        self._shares = masses / masses[1:].sum()
        self._levers = levers

    def frames(self, configurations: Array) -> tuple[Array, Array]:
        """Return rotation (k, J, 3, 3) and origin [m] (k, J, 3) of each joint, world.

        Args:
            configurations: As in RobotState, (k, 19).
        """
        count = len(configurations)
        rotations = np.empty((count, len(self._parents), 3, 3))
        origins = np.empty((count, len(self._parents), 3))
        rotations[:, 0], origins[:, 0] = np.eye(3), 0.0
        rotations[:, 1] = rotations_of(configurations[:, 3:FREE_FLYER])
        origins[:, 1] = configurations[:, :3]
        for k, axis in enumerate(self._axes):
            joint, parent = k + 2, self._parents[k + 2]
            above = rotations[:, parent]
            origins[:, joint] = origins[:, parent] + above @ self._offsets[joint]
            turned = above @ self._turns[joint]
            rotations[:, joint] = _turned(turned, axis, configurations[:, FREE_FLYER + k])
        return rotations, origins

    def centres_of_mass(self, configurations: Array) -> Array:
        """Return the CoM of each configuration, world [m], (k, 3)."""
        rotations, origins = self.frames(configurations)
        bodies = origins + np.einsum('kjab,jb->kja', rotations, self._levers)
        centres: Array = np.einsum('j,kja->ka', self._shares, bodies)
        return centres

    def com_velocity(self, configuration: Array, velocity: Array) -> Array:
        """Return the velocity of the CoM in the world for one state [m/s], (3,)."""
        pin.centerOfMass(self._model, self._data, configuration, velocity)
        return np.array(self._data.vcom[0])

    def cover_centres(self, configurations: Array) -> Array:
        """Return the centres of the covering spheres, world [m], (k, S, 3)."""
        rotations, origins = self.frames(configurations)
        joint = self.cover.joint
        turned = np.einsum('ksab,sb->ksa', rotations[:, joint], self.cover.centre)
        centres: Array = origins[:, joint] + turned
        return centres

    def placements(self, configuration: Array) -> list[coal.Transform3s]:
        """Return the pose of each shape in the world, for one configuration (19,)."""
        quaternion = configuration[3:FREE_FLYER]
        q = configuration.copy()
        q[3:FREE_FLYER] = quaternion / np.linalg.norm(quaternion)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, q)
        return [coal.Transform3s(pose.rotation, pose.translation) for pose in self._placed.oMg]


class Centres(Protocol):
    """Where a robot's plan is meant to be, and how that point moves."""

    def centres_of_mass(self, configurations: Array) -> Array:
        """Return the point in each configuration, world [m], (k, 3)."""
        ...

    def com_velocity(self, configuration: Array, velocity: Array) -> Array:
        """Return its velocity in the world for one state [m/s], (3,)."""
        ...


def rotations_of(quaternions: Array) -> Array:
    """Return the rotation matrices of quaternions x, y, z, w of any length, (k, 3, 3)."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _turned(rotations: Array, axis: int, angles: Array) -> Array:
    """Return R times the rotation by an angle about one of its own axes, (k, 3, 3)."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    result = np.empty_like(rotations)
    result[:, :, axis] = rotations[:, :, axis]
    result[:, :, one] = cos * rotations[:, :, one] + sin * rotations[:, :, other]
    result[:, :, other] = cos * rotations[:, :, other] - sin * rotations[:, :, one]
    return result


def _axis(joint: pin.JointModel) -> int:
    """Return the number of the coordinate axis that a joint turns about.

    Raises:
        BagError: If it is another joint.
    """
    names = ('JointModelRX', 'JointModelRY', 'JointModelRZ')
    if joint.shortname() not in names:
        raise BagError(f'robot description: joint of type {joint.shortname()}; must be revolute')
    return names.index(joint.shortname())


def _cover(objects: list[pin.GeometryObject]) -> Cover:
    """Cover each shape with spheres: a box with several, a cylinder or sphere with one."""
    joints, centres, radii = [], [], []
    for thing in objects:
        for centre, radius in _spheres(thing.geometry):
            joints.append(thing.parentJoint)
            centres.append(thing.placement.act(centre))
            radii.append(radius)
    return Cover(np.array(joints, dtype=np.intp), np.array(centres), np.array(radii))


def _spheres(shape: coal.CollisionGeometry) -> list[tuple[Array, float]]:
    """Return spheres in the frame of a shape that contain it: centre [m], radius [m]."""
    if not isinstance(shape, coal.Box):
        return [(np.zeros(3), _radius(shape))]
    half = np.array(shape.halfSide)
    longest = int(half.argmax())
    piece = half.copy()
    piece[longest] /= SPHERES_A_BOX
    spheres = []
    for k in range(SPHERES_A_BOX):
        centre = np.zeros(3)
        centre[longest] = -half[longest] + (2 * k + 1) * piece[longest]
        spheres.append((centre, float(np.linalg.norm(piece))))
    return spheres


def _radius(shape: coal.CollisionGeometry) -> float:
    """Return the largest distance of any part of a shape from its origin [m].

    Raises:
        BagError: If the shape is none that is known.
    """
    if isinstance(shape, coal.Sphere):
        return float(shape.radius)
    if isinstance(shape, coal.Cylinder):
        return float(np.hypot(shape.radius, shape.halfLength))
    if isinstance(shape, coal.Box):
        return float(np.linalg.norm(shape.halfSide))
    raise BagError(f'robot description: a shape is {type(shape).__name__}; no bound is known')
