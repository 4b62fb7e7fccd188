"""psi0 and psi1 as recomputed and as published: are they safe, and are they the same?"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.barriers import PairBarrier, pair_barriers
from layered_cbf_ros.bags.audit.body_geometry import Centres
from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_least, at_most, not_proven
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import RunParameters
from layered_cbf_ros.bags.audit.scene import Scene, scene_of
from layered_cbf_ros.bags.audit.track_rows import FAR, track_rows
from layered_cbf_ros.bags.audit.world import Motions
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.node_topics import BARRIERS
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import REAL_TIME

UNITS = ('m', 'm/s')


def check_barriers(
    evidence: Evidence,
    motions: Motions,
    geometry: Centres,
    run: RunParameters | None,
    limits: Limits,
) -> list[Check]:
    """Check psi0 and psi1 of every pair, recomputed, published and beside each other."""
    published = _published(evidence, limits)
    names = [f'psi{k} {what}' for what in ('recomputed', 'difference') for k in range(2)]
    scenario = evidence.scenario
    if run is None or scenario is None:
        return [*published, *(not_proven(name, 'its parameters are not known') for name in names)]
    try:
        scene = scene_of(evidence, scenario, motions, geometry, run)
    except BagError as error:
        return [*published, *(not_proven(name, str(error)) for name in names)]
    compared = _Comparison(evidence, scenario, scene, run, limits)
    compared.compare_all()
    count, states = len(scene.stamps_ns), len(motions.stamps_ns)
    note = f'at {count} of {states} states: those that have a plan, or lie between two'
    checks = [*published]
    for k in range(2):
        checks.append(at_least(names[k], UNITS[k], compared.recomputed[k], compared.holes, [note]))
    for k in range(2):
        checks.append(at_most(names[2 + k], UNITS[k], compared.differences[k], compared.holes))
    return checks


def has_pairs(evidence: Evidence) -> bool:
    """Tell whether there is anything that a robot must be kept apart from."""
    scenario = evidence.scenario
    others = scenario is None or len(scenario.robots) > 1 or bool(scenario.walls)
    return others or bool(evidence.tracks())


def _published(evidence: Evidence, limits: Limits) -> list[Check]:
    """Check that the published psi0 and psi1 stay in the safe set."""
    names = [f'psi{k} published' for k in range(2)]
    trace = evidence.traces.get(BARRIERS)
    if trace is None and not has_pairs(evidence):
        return [at_least(name, unit, ()) for name, unit in zip(names, UNITS, strict=True)]
    if trace is None:
        return [not_proven(name, f'no {BARRIERS}') for name in names]
    series = trace.series
    checks = []
    for k, name in enumerate(names):
        samples = []
        for column, label in enumerate(series.names):
            values = series.values[:, k, column]
            told = ~np.isnan(values)  # a pair comes and goes with its track
            times = evidence.seconds(series.stamps_ns[told])
            samples.append(Samples(label, times, values[told], limits.barrier))
        checks.append(at_least(name, UNITS[k], samples))
    return checks


def _misfit(published: Array, pair: PairBarrier, k: int) -> Array:
    """Return how far psi lies outside of the range of the best candidate, (K,)."""
    below, above = pair.low[k] - published, published - pair.high[k]
    outside = np.where(pair.present, np.maximum(np.maximum(below, above), 0.0), np.inf)
    outside[np.isnan(outside)] = np.inf
    nearest: Array = outside.min(axis=0)
    return nearest


@dataclass
class _Comparison:
    """Puts what was recomputed beside what was published, pair by pair.

    Attributes:
        evidence, scenario, scene, run, limits: What is compared.
        recomputed, differences: Samples of psi0 and of psi1.
        holes: What could not be compared.
    """

    evidence: Evidence
    scenario: Scenario
    scene: Scene
    run: RunParameters
    limits: Limits
    recomputed: tuple[list[Samples], list[Samples]] = field(default_factory=lambda: ([], []))
    differences: tuple[list[Samples], list[Samples]] = field(default_factory=lambda: ([], []))
    holes: list[str] = field(default_factory=list)

    def compare_all(self) -> None:
        """Compare all pairs of robots, robots and walls, robots and tracks."""
        stamps_ns, tracks = self.scene.stamps_ns, self.evidence.tracks()
        rows = {name: track_rows(self.scenario, trace, stamps_ns) for name, trace in tracks.items()}
        everybody = len(tracks) <= self.run.max_obstacles
        always = np.ones(len(stamps_ns), dtype=np.bool_)
        pairs = pair_barriers(self.scenario, self.scene, self.run, rows)
        told = self.evidence.traces.get(BARRIERS)
        for label in sorted(set(told.series.names if told else ()) - {p.label for p in pairs}):
            self.holes.append(f'{label}: nothing is known of one of the two')
        for pair in pairs:
            track = rows.get(pair.label.partition('~')[2])
            certain = always if track is None else track.certain & everybody
            self._compare(pair, certain)

    def _compare(self, pair: PairBarrier, certain: NDArray[np.bool_]) -> None:
        times, limit = self.evidence.seconds(self.scene.stamps_ns), self.limits.barrier_difference
        published = self._published(pair.label)
        known = ~np.isnan(published).any(axis=1)
        explained = pair.present.any(axis=0)
        lacking, unexplained = certain & ~known, known & ~explained
        if lacking.any():
            what = f'{BARRIERS} lacks {pair.label} at {lacking.sum()} stamps'
            self.holes.append(f'{what}, first at {times[lacking][0]:.3f} s')
        if unexplained.any():
            what = f'{pair.label}: at {unexplained.sum()} stamps no track explains psi'
            self.holes.append(f'{what}, first at {times[unexplained][0]:.3f} s')
        both = known & explained
        misfits = np.array([_misfit(published[:, k], pair, k) for k in range(2)])
        doubtful = np.logical_and(both, (misfits > limit).any(axis=0))
        if doubtful.any() and self.scenario.time == REAL_TIME:
            misfits[:, doubtful] = self._other_tracks(pair.label, doubtful, published[doubtful])
        rows = pair.present[0]
        for k, psi in enumerate((pair.psi0, pair.psi1)):
            here = Samples(pair.label, times[rows], psi[0, rows], self.limits.barrier)
            self.recomputed[k].append(here)
            self.differences[k].append(Samples(pair.label, times[both], misfits[k, both], limit))

    def _other_tracks(self, label: str, chosen: NDArray[np.bool_], published: Array) -> Array:
        """Return the misfits at some stamps when every track that is possible is tried."""
        name, part = label.partition('~')[2], self.scene.part(chosen)
        trace = self.evidence.tracks().get(name)
        tracks = {} if trace is None else {name: track_rows(
            self.scenario, trace, part.stamps_ns, FAR
        )}  # fmt: skip
        pairs = pair_barriers(self.scenario, part, self.run, tracks)
        (pair,) = [pair for pair in pairs if pair.label == label]
        return np.array([_misfit(published[:, k], pair, k) for k in range(2)])

    def _published(self, label: str) -> Array:
        """Return the published psi0, psi1 at the stamps of the scene, NaN if absent, (K, 2)."""
        trace = self.evidence.traces.get(BARRIERS)
        values = np.full((len(self.scene.stamps_ns), 2), np.nan)
        if trace is not None and label in trace.series.names:
            series = trace.series
            _, rows, own = np.intersect1d(
                self.scene.stamps_ns, series.stamps_ns, return_indices=True
            )
            values[rows] = series.values[own, :2, series.names.index(label)]
        return values
