"""Orientations as quaternions x, y, z, w, of the base in the world."""

from __future__ import annotations

import math

import numpy as np

from layered_cbf_ros.interfaces import Array


def matrix(quaternion: Array) -> Array:
    """Return the rotation matrix of a unit quaternion x, y, z, w, (3, 3)."""
    x, y, z, w = quaternion.tolist()
    return np.array(
        (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
            (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
            (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
        )
    )


def turned(quaternion: Array, yaw: float) -> Array:
    """Return an orientation turned about the vertical of the world by an angle [rad]."""
    x, y, z, w = quaternion.tolist()
    sin, cos = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    product = np.array((cos * x - sin * y, cos * y + sin * x, cos * z + sin * w, cos * w - sin * z))
    return product / math.sqrt(float(product @ product))
