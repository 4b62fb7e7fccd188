"""psi0 and psi1 of every pair, computed anew from plan, tracks and wishes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.lens import barrier, enclosed_barrier
from layered_cbf_ros.bags.audit.reach import ACCURACY, agent_reaches, box_reach, track_growth
from layered_cbf_ros.bags.audit.run_parameters import RunParameters
from layered_cbf_ros.bags.audit.scene import Scene
from layered_cbf_ros.bags.audit.track_rows import TrackRows
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.scenario import Scenario, Wall

BLOCK = 8192
"""Stamps that are computed together."""


@dataclass(frozen=True, slots=True)
class PairBarrier:
    """psi0 and psi1 of one pair at K stamps.

    Attributes:
        label: `one~other`, as on /coordinator/barriers.
        present: Whether the pair exists for each candidate of its track, (C, K).
        psi0, psi1: [m], [m/s], for each candidate, (C, K).
        low, high: Least and greatest psi0, psi1 that the accuracy of the reaches allows,
            (2, C, K).
    """

    label: str
    present: NDArray[np.bool_]
    psi0: Array
    psi1: Array
    low: Array
    high: Array


def pair_barriers(
    scenario: Scenario, scene: Scene, run: RunParameters, tracks: Mapping[str, TrackRows]
) -> list[PairBarrier]:
    """Return the barriers of all pairs of robots, robots and tracks, robots and walls.

    Args:
        scenario: Its walls and radii count.
        scene: The robots.
        run: Gains, limits and horizon.
        tracks: What was known of each track, at the stamps of the scene.
    """
    # The tracker doesn't see radii: every track gets that of the largest obstacle.
    radius = max((obstacle.radius for obstacle in scenario.obstacles), default=0.0)
    blocks = []
    for begin in range(0, len(scene.stamps_ns), BLOCK):
        rows = slice(begin, begin + BLOCK)
        part = scene.part(rows)
        block = [*_robot_pairs(part, run)]
        for name, track in tracks.items():
            block += _track_pairs(part, run, name, track.part(rows), radius)
        for wall in scenario.walls:
            block += _wall_pairs(part, run, wall)
        blocks.append(block)
    return [_joined(parts) for parts in zip(*blocks, strict=True)]


def _robot_pairs(scene: Scene, run: RunParameters) -> Iterator[PairBarrier]:
    """Yield the pairs of robots: of both directions the one with the smaller h counts."""
    pairs = list(itertools.combinations(range(len(scene.robots)), 2))
    if not pairs:
        return
    one, other = np.array(pairs, dtype=np.intp).T
    apart = scene.position[:, other] - scene.position[:, one]
    distance, direction = _polar(apart)
    rate = ((scene.velocity[:, other] - scene.velocity[:, one]) * direction).sum(axis=2)
    both, along = np.concatenate((one, other)), np.concatenate((direction, direction), axis=1)
    law = run.horizon, run.gain, run.acceleration_limit
    known = agent_reaches(scene.velocity, scene.target, both, along, law)
    unknown = box_reach(scene.velocity[:, both], along, run.horizon)
    reach = np.where(scene.held[:, both], unknown, known)
    first, second = reach[:, : len(pairs)], reach[:, len(pairs) :]
    radii = np.array([run.radii[name] for name in scene.robots])
    size = radii[one] + radii[other]
    ways = (first, second + size), (second, first + size)
    psi0 = np.min([barrier(distance, *way) for way in ways], axis=0)
    ranges = [enclosed_barrier(distance, *way, ACCURACY) for way in ways]
    low, high = (np.min([bounds[k] for bounds in ranges], axis=0) for k in range(2))
    for k, (i, j) in enumerate(pairs):
        label = f'{scene.robots[i]}~{scene.robots[j]}'
        ends = psi0[:, k], low[:, k], high[:, k]
        yield _pair(label, run.alpha1, rate[:, k], *ends)


def _track_pairs(
    scene: Scene, run: RunParameters, name: str, track: TrackRows, radius: float
) -> Iterator[PairBarrier]:
    """Yield the pairs of every robot and one track; the candidates one after the other."""
    agents = np.arange(len(scene.robots))
    law = run.horizon, run.gain, run.acceleration_limit
    unseen = run.horizon, run.obstacle_acceleration, run.confidence
    radii, found = np.array([run.radii[name] for name in scene.robots]), []
    for state, stamps_ns in zip(track.states, track.stamps_ns, strict=True):
        age = np.clip((scene.stamps_ns - stamps_ns) / NS_PER_S, 0.0, run.track_age_limit)
        distance, direction = _polar(state[:, None, :2] - scene.position)
        rate = ((state[:, None, 2:4] - scene.velocity) * direction).sum(axis=2)
        reach = agent_reaches(scene.velocity, scene.target, agents, direction, law)
        ball = box_reach(state[:, None, 2:4], direction, (run.horizon + age)[:, None])
        ball += (track_growth(state[:, 4:], age, unseen) + radius)[:, None] + radii
        psi0 = barrier(distance, reach, ball)
        found.append((rate, psi0, *enclosed_barrier(distance, reach, ball, ACCURACY)))
    rate, psi0, low, high = map(np.array, zip(*found, strict=True))
    for k, robot in enumerate(scene.robots):
        ends = psi0[..., k], low[..., k], high[..., k]
        pair = _pair(f'{robot}~{name}', run.alpha1, rate[..., k], *ends)
        yield PairBarrier(pair.label, track.present, pair.psi0, pair.psi1, pair.low, pair.high)


def _wall_pairs(scene: Scene, run: RunParameters, wall: Wall) -> Iterator[PairBarrier]:
    """Yield the pairs of every robot and a wall, which need no reach."""
    (px, py), (nx, ny) = wall.point, wall.normal
    for k, robot in enumerate(scene.robots):
        (x, y), (vx, vy) = scene.position[:, k].T, scene.velocity[:, k].T
        h = nx * (x - px) + ny * (y - py) - run.radii[robot]
        yield _pair(f'{robot}~{wall.name}', run.wall_alpha1, nx * vx + ny * vy, h, h, h)


def _pair(
    label: str, alpha1: float, rate: Array, psi0: Array, low: Array, high: Array
) -> PairBarrier:
    """Return a pair that always exists; psi1 = psi0' + alpha1 psi0, paper eq. (16).

    psi0' is the rate of the distance alone: the ball is carried along, its radius kept.
    """
    h = np.atleast_2d(psi0)
    low, high = np.atleast_2d(low), np.atleast_2d(high)
    return PairBarrier(
        label,
        np.ones(h.shape, dtype=np.bool_),
        h,
        rate + alpha1 * h,
        np.array([low, rate + alpha1 * low]),
        np.array([high, rate + alpha1 * high]),
    )


def _polar(vectors: Array) -> tuple[Array, Array]:
    """Return length and direction of vectors, (..., 2)."""
    length = np.sqrt((vectors * vectors).sum(axis=-1))
    return length, vectors / np.maximum(length, 1e-9)[..., None]


def _joined(parts: tuple[PairBarrier, ...]) -> PairBarrier:
    """Return one pair whose stamps were computed in parts."""
    return PairBarrier(
        parts[0].label,
        np.concatenate([part.present for part in parts], axis=-1),
        np.concatenate([part.psi0 for part in parts], axis=-1),
        np.concatenate([part.psi1 for part in parts], axis=-1),
        np.concatenate([part.low for part in parts], axis=-1),
        np.concatenate([part.high for part in parts], axis=-1),
    )
