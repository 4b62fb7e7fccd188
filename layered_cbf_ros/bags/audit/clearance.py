"""Surface distance of every pair, proven at every sample (branch and bound).

Spheres that cover the robot give a lower bound at every sample. Only where a bound lies
below the smallest distance found so far, or below zero, shapes are asked exactly. So the
smallest distance of a pair is exact, and so is every one that breaks the promise; all
other values are lower bounds.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import coal
import numpy as np

from layered_cbf_ros.bags.audit.body_geometry import BodyGeometry
from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_least
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.surfaces import Cylinder, HalfSpace, Other, RobotBody
from layered_cbf_ros.bags.audit.world import Motions
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.node_topics import TRUTH

BLOCK = 256
"""Samples whose finer bounds are computed together."""

ROUNDING = 1e-9
"""Taken off every bound, so that rounding can't raise one above the distance [m]."""


def check_clearance(
    evidence: Evidence, motions: Motions, geometry: BodyGeometry, limits: Limits
) -> Check:
    """Check that no robot's surface touches another body's."""
    samples, holes = [], list(motions.holes)
    bodies = {
        name: RobotBody(geometry, q, _reach(geometry, q)) for name, q in motions.robots.items()
    }
    for label, body, other in _pairs(evidence, motions, bodies):
        values = distances(body, other, limits.clearance)
        samples.append(Samples(label, motions.times, values, limits.clearance))
    notes = [f'{TRUTH} is interpolated between its stamps'] if motions.obstacles else []
    notes.append('exact where smallest and where broken; else a lower bound')
    return at_least('clearance', 'm', samples, holes, notes, relation='>')


def distances(body: RobotBody, other: Other, limit: float) -> Array:
    """Return the distance of a pair at every sample [m], (k,).

    Args:
        body: The robot.
        other: The other body.
        limit: Values up to here are exact, and so is the smallest; others are lower
            bounds [m].
    """
    bounds = other.coarse(body.configurations[:, :3], body.reach) - ROUNDING
    if not np.isfinite(bounds).all():  # told as not finite; the rest has no order
        return bounds
    radii, best = body.geometry.cover.radius, np.inf
    order = np.argsort(bounds)
    for begin in range(0, len(order), BLOCK):
        rows = order[begin : begin + BLOCK]
        if bounds[rows[0]] > max(best, limit):
            break
        centres = body.geometry.cover_centres(body.configurations[rows])
        bounds[rows] = other.fine(rows, centres, radii).min(axis=1) - ROUNDING
        for row in rows[np.argsort(bounds[rows])]:
            if bounds[row] > max(best, limit):
                break
            bounds[row] = exact_distance(body, other, int(row))
            best = min(best, float(bounds[row]))
    return bounds


def exact_distance(body: RobotBody, other: Other, row: int) -> float:
    """Return the distance of a pair at one sample, negative in penetration [m]."""
    own, solids = body.solids(row), other.solids(row)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    a = np.array([solid.pose.getTranslation() for solid in own])
    b = np.array([solid.pose.getTranslation() for solid in solids])
    bounds = np.linalg.norm(a[:, None] - b, axis=2)
    bounds -= np.add.outer([solid.radius for solid in own], [solid.radius for solid in solids])
    best = np.inf
    for k in np.argsort(bounds, axis=None):
        i, j = np.unravel_index(k, bounds.shape)
        if bounds[i, j] >= best:
            break
        one, thing = own[i], solids[j]
        result.clear()
        distance = coal.distance(one.shape, one.pose, thing.shape, thing.pose, request, result)
        best = min(best, float(distance))
    return best


def _reach(geometry: BodyGeometry, configurations: Array) -> Array:
    """Return how far any part is from the base at most, at every sample [m], (k,)."""
    reach = np.empty(len(configurations))
    for begin in range(0, len(reach), 4 * BLOCK):
        part = configurations[begin : begin + 4 * BLOCK]
        centres = geometry.cover_centres(part) - part[:, None, :3]
        sizes = np.linalg.norm(centres, axis=2) + geometry.cover.radius
        reach[begin : begin + len(part)] = sizes.max(axis=1)
    return reach


def _pairs(
    evidence: Evidence, motions: Motions, bodies: dict[str, RobotBody]
) -> Iterator[tuple[str, RobotBody, Other]]:
    """Yield label and bodies of each pair that must not touch."""
    for (a, body), (b, other) in itertools.combinations(bodies.items(), 2):
        yield f'{a}~{b}', body, other
    if evidence.scenario is None:
        return
    for name, body in bodies.items():
        for obstacle in evidence.scenario.obstacles:
            if obstacle.name in motions.obstacles:
                positions = motions.obstacles[obstacle.name]
                yield f'{name}~{obstacle.name}', body, Cylinder(obstacle, positions)
        for wall in evidence.scenario.walls:
            yield f'{name}~{wall.name}', body, HalfSpace(wall)
