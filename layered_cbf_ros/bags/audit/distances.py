"""Distance between centres of every pair at every state."""

from __future__ import annotations

import itertools

import numpy as np

from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_least, not_proven
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import RunParameters
from layered_cbf_ros.bags.audit.world import Motions
from layered_cbf_ros.node_topics import TRUTH

NAME = 'centre distance'


def check_distances(
    evidence: Evidence, motions: Motions, run: RunParameters | None, limits: Limits
) -> Check:
    """Check that centres stay as far apart as the coordinator promises.

    The centre of a robot is the origin of its trunk in the plane; from a wall it must
    stay one radius away.
    """
    scenario = evidence.scenario
    if run is None or scenario is None:
        return not_proven(NAME, 'the radii are not known')
    samples = []
    slip, radii, times = limits.distance_slip, run.radii, motions.times
    centres = {name: q[:, :2] for name, q in motions.robots.items()}
    for a, b in itertools.combinations(centres, 2):
        apart = np.linalg.norm(centres[a] - centres[b], axis=1)
        samples.append(Samples(f'{a}~{b}', times, apart, radii[a] + radii[b] - slip))
    for a, centre in centres.items():
        for thing in scenario.obstacles:
            if thing.name in motions.obstacles:
                apart = np.linalg.norm(centre - motions.obstacles[thing.name], axis=1)
                promised = radii[a] + thing.radius - slip
                samples.append(Samples(f'{a}~{thing.name}', times, apart, promised))
        for wall in scenario.walls:
            (px, py), (nx, ny) = wall.point, wall.normal
            apart = nx * (centre[:, 0] - px) + ny * (centre[:, 1] - py)
            samples.append(Samples(f'{a}~{wall.name}', times, apart, radii[a] - slip))
    notes = [f'{TRUTH} is interpolated between its stamps'] if motions.obstacles else []
    return at_least(NAME, 'm', samples, motions.holes, notes)
