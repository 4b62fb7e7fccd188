"""From tracks to the bodies that barriers see: checked, nearest first, aged."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.barriers import Bodies
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.reachable_sets import unseen_growth
from layered_cbf_ros.interfaces import NS_PER_S, Array, Track


def heeded_tracks(
    tracks: Sequence[Track], agents: Array, limit: int
) -> tuple[tuple[Track, ...], int, int]:
    """Return the tracks that count, and how many were rejected and left out.

    Args:
        tracks: As received.
        agents: Planned positions in the world [m], (N, 2).
        limit: Number of tracks that fit; the nearest to any agent are kept.

    Returns:
        Tracks in their given order, number that isn't finite, number left out.
    """
    sound = tuple(track for track in tracks if _is_finite(track))
    rejected = len(tracks) - len(sound)
    if len(sound) <= limit:
        return sound, rejected, 0
    clearance = [
        float(np.hypot(*(agents - track.position).T).min()) - track.radius for track in sound
    ]
    nearest = sorted(np.argsort(clearance, kind='stable')[:limit].tolist())
    return tuple(sound[k] for k in nearest), rejected, len(sound) - limit


def bodies_at(stamp_ns: int, tracks: Sequence[Track], parameters: CoordinatorParameters) -> Bodies:
    """Return the tracks as bodies whose sets start at the stamps of the tracks.

    A set that started `age` ago and reaches `horizon` ahead of now extends over
    age + horizon: what isn't known is assumed worse. The age counts up to
    track_age_limit, so that a lost track can't fill the world.

    Args:
        stamp_ns: Now [ns].
        tracks: Finite tracks.
        parameters: Horizon, confidence and limits.
    """
    p, count = parameters, len(tracks)
    ages = [
        min(max(stamp_ns - track.stamp_ns, 0) / NS_PER_S, p.track_age_limit) for track in tracks
    ]
    growth = [
        unseen_growth(age, p.horizon, p.obstacle_acceleration, track.covariance, p.confidence)
        for age, track in zip(ages, tracks, strict=True)
    ]
    return Bodies(
        tuple(track.name for track in tracks),
        np.array([track.position for track in tracks], dtype=float).reshape(count, 2),
        np.array([track.velocity for track in tracks], dtype=float).reshape(count, 2),
        np.array([track.radius for track in tracks], dtype=float),
        np.array(ages, dtype=float) + p.horizon,
        np.array(growth, dtype=float),
    )


def _is_finite(track: Track) -> bool:
    parts = (track.position, track.velocity, track.covariance)
    return math.isfinite(sum(float(np.vdot(part, part)) for part in parts) + track.radius)
