"""Obstacles to be seen: where they truly are if that is known, else where they are tracked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array, Track
from layered_cbf_ros.scenario import Obstacle
from layered_cbf_ros.viewing.sight.snapshot import ObstacleSight

TRACKED_HEIGHT = 0.8
"""How high a track is drawn, whose height nobody tells [m]."""


def true_obstacles(
    obstacles: Sequence[Obstacle], positions: Array, velocities: Array
) -> tuple[ObstacleSight, ...]:
    """Return the scenario's obstacles where they truly are.

    Args:
        obstacles: In the order of the positions.
        positions: Centres in the world plane [m], (n, 2); only finite ones are seen.
        velocities: Their velocities [m/s], (n, 2).
    """
    return tuple(
        ObstacleSight(
            obstacle.name, position, velocity, obstacle.radius, obstacle.height, is_tracked=False
        )
        for obstacle, position, velocity in zip(obstacles, positions, velocities, strict=False)
        if np.isfinite(position).all()
    )


def tracked_obstacles(tracks: Sequence[Track]) -> tuple[ObstacleSight, ...]:
    """Return obstacles as the tracker knows them."""
    return tuple(
        ObstacleSight(
            track.name, track.position, track.velocity, track.radius, TRACKED_HEIGHT, True
        )
        for track in tracks
    )


def velocities_between(stamps_ns: Sequence[int], earlier: Array, later: Array) -> Array:
    """Return velocities [m/s] by the positions [m] at two stamps [ns]; zero if they are one."""
    seconds = (stamps_ns[1] - stamps_ns[0]) / NS_PER_S
    if earlier.shape != later.shape or seconds <= 0.0:
        return np.zeros_like(later)
    velocities: Array = (later - earlier) / seconds
    return velocities
