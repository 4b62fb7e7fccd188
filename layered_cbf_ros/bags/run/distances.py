"""Distances between the bodies of a run, centre to centre in the plane."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.discs import disc_radii
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


def pair_distances(record: RunRecord) -> list[PairDistance]:
    """Return every robot pair at each state, every robot-obstacle pair at equal stamps."""
    if record.state is None:
        return []
    stamps = record.state.stamps_ns
    bases = {name: motion.configurations[:, :2] for name, motion in record.motions.items()}
    times, scenario = record.seconds(stamps), record.scenario
    radii = {} if scenario is None else disc_radii(scenario)
    usual = CoordinatorParameters.agent_radius
    sizes = {name: radii.get(name, usual) for name in bases}
    pairs = []
    for a, b in itertools.combinations(bases, 2):
        distance = np.hypot(*(bases[a] - bases[b]).T)
        pairs.append(PairDistance(f'{a}~{b}', times, distance, sizes[a] + sizes[b]))
    if record.obstacles is None or scenario is None:
        return pairs
    _, rows, seen = np.intersect1d(stamps, record.obstacles.stamps_ns, return_indices=True)
    for a in record.motions if len(rows) else ():
        for k, obstacle in enumerate(scenario.obstacles[: record.obstacles.positions.shape[1]]):
            apart = bases[a][rows] - record.obstacles.positions[seen, k]
            label, promised = f'{a}~{obstacle.name}', sizes[a] + obstacle.radius
            pairs.append(PairDistance(label, times[rows], np.hypot(*apart.T), promised))
    return pairs
