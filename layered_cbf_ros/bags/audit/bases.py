"""What the audit needs of robots without legs: their states, their discs, what they were told."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

import numpy as np

from layered_cbf_ros.bags.audit.body_geometry import rotations_of
from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_least, not_proven
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import RunParameters
from layered_cbf_ros.bags.audit.world import Motions
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.node_topics import TRUTH
from layered_cbf_ros.scenario import Scenario

NAME = 'clearance'


class DiscGeometry:
    """A base is where the centre of its disc is; stands in for the geometry of an A1."""

    def centres_of_mass(self, configurations: Array) -> Array:
        """Return the centre of each pose, world [m], (k, 3)."""
        return configurations[:, :3]

    def com_velocity(self, configuration: Array, velocity: Array) -> Array:
        """Return its velocity in the world for one state [m/s], (3,)."""
        turned: Array = rotations_of(configuration[None, 3:7])[0] @ velocity[:3]
        return turned


def check_disc_clearance(
    evidence: Evidence, motions: Motions, run: RunParameters | None, limits: Limits
) -> Check:
    """Check that no base's body touches another one: upright cylinders, distances exact."""
    scenario = evidence.scenario
    if run is None or scenario is None:
        return not_proven(NAME, 'the radii are not known')
    bodies = {name: run.radii[name] - run.base_margin for name in motions.robots}
    samples = [
        Samples(label, motions.times, gap, limits.clearance)
        for label, gap in _gaps(scenario, motions, bodies)
    ]
    notes = [f'{TRUTH} is interpolated between its stamps'] if motions.obstacles else []
    notes.append(f'bodies are {run.base_margin:g} m smaller than their discs')
    return at_least(NAME, 'm', samples, motions.holes, notes, relation='>')


def _gaps(
    scenario: Scenario, motions: Motions, bodies: Mapping[str, float]
) -> Iterator[tuple[str, Array]]:
    """Yield label and surface distance [m] of each pair that must not touch, (k,)."""
    centres = {name: poses[:, :2] for name, poses in motions.robots.items()}
    for a, b in itertools.combinations(centres, 2):
        yield f'{a}~{b}', np.linalg.norm(centres[a] - centres[b], axis=1) - bodies[a] - bodies[b]
    for name, centre in centres.items():
        for thing in scenario.obstacles:
            if thing.name in motions.obstacles:
                apart = np.linalg.norm(centre - motions.obstacles[thing.name], axis=1)
                yield f'{name}~{thing.name}', apart - bodies[name] - thing.radius
        for wall in scenario.walls:
            room = (centre - wall.point) @ np.array(wall.normal)
            yield f'{name}~{wall.name}', room - bodies[name]
