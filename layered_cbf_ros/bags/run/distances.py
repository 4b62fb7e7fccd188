"""Distances between the bodies of a run, centre to centre in the plane."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import Array


@dataclass(frozen=True, slots=True)
class PairDistance:
    """Distance of two bodies over time.

    Attributes:
        label: `a~b`, as on /simulator/clearance.
        times: Since the first state [s], (k,).
        distances: Between the centres [m], (k,).
        promised: Sum of the two radii, which the coordinator keeps them apart [m].
    """

    label: str
    times: Array
    distances: Array
    promised: float

    @property
    def smallest(self) -> float:
        """Smallest distance [m]."""
        return float(self.distances.min())

    @property
    def margin(self) -> float:
        """Smallest distance less the promised one [m]."""
        return self.smallest - self.promised


def agent_radius(record: RunRecord) -> float:
    """Return the radius of the disc around a robot in this run [m].

    A scenario that a supervisor ran holds every parameter; one that was run without
    it only what it overrides.
    """
    scenario = record.scenario
    coordinator = {} if scenario is None else scenario.parameters.get('coordinator', {})
    return float(coordinator.get('agent_radius', CoordinatorParameters.agent_radius))


def pair_distances(record: RunRecord) -> list[PairDistance]:
    """Return every robot pair at each state, every robot-obstacle pair at equal stamps."""
    if record.state is None:
        return []
    stamps = record.state.stamps_ns
    bases = {name: motion.configurations[:, :2] for name, motion in record.motions.items()}
    times, radius = record.seconds(stamps), agent_radius(record)
    pairs = []
    for a, b in itertools.combinations(bases, 2):
        distance = np.hypot(*(bases[a] - bases[b]).T)
        pairs.append(PairDistance(f'{a}~{b}', times, distance, 2.0 * radius))
    scenario = record.scenario
    if record.obstacles is None or scenario is None:
        return pairs
    _, rows, seen = np.intersect1d(stamps, record.obstacles.stamps_ns, return_indices=True)
    for a in record.motions if len(rows) else ():
        for k, obstacle in enumerate(scenario.obstacles[: record.obstacles.positions.shape[1]]):
            apart = bases[a][rows] - record.obstacles.positions[seen, k]
            label, promised = f'{a}~{obstacle.name}', radius + obstacle.radius
            pairs.append(PairDistance(label, times[rows], np.hypot(*apart.T), promised))
    return pairs
