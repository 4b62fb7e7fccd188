"""What the coordinator's barriers saw, out of what was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.body_geometry import Centres
from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.integration import carried
from layered_cbf_ros.bags.audit.run_parameters import RunParameters, timing_of
from layered_cbf_ros.bags.audit.trace import Trace
from layered_cbf_ros.bags.audit.world import VELOCITY, Motions
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.node_topics import DESIRED, PLAN
from layered_cbf_ros.scenario import Scenario

EFFORT = 3
"""Field of a JointTrajectory that tells on DESIRED whether a robot is held."""

SAME_PLACE = 1e-9
"""A frozen plan stands exactly where its robot was measured [m]."""


@dataclass(frozen=True, slots=True)
class Scene:
    """N robots at K ticks of the coordinator; world frame.

    Attributes:
        stamps_ns: [ns], (K,).
        robots: Names, (N,).
        position, velocity: Planned [m], [m/s], the velocity of frozen robots measured,
            (K, N, 2).
        target: Desired velocities [m/s], (K, N, 2).
        held: Who can't obey, (K, N).
    """

    stamps_ns: NDArray[np.int64]
    robots: Sequence[str]
    position: Array
    velocity: Array
    target: Array
    held: NDArray[np.bool_]

    def part(self, rows: slice | NDArray[np.bool_]) -> Scene:
        """Return some of the stamps."""
        return Scene(
            self.stamps_ns[rows],
            self.robots,
            self.position[rows],
            self.velocity[rows],
            self.target[rows],
            self.held[rows],
        )


def scene_of(
    evidence: Evidence,
    scenario: Scenario,
    motions: Motions,
    geometry: Centres,
    run: RunParameters,
) -> Scene:
    """Return the scene at every tick for which wishes and states were recorded.

    Between two plans the first one is carried on by the applied inputs; check_plan
    proves that this leads to the second. Ticks between plans at which a robot is frozen
    are left out: its plan jumps.

    Raises:
        BagError: If the bag doesn't tell it.
    """
    plan, desired = _needed(evidence, PLAN).series, _needed(evidence, DESIRED).series
    robots = [robot.name for robot in scenario.robots]
    axes = desired.columns([f'{name}/{axis}' for name in robots for axis in 'xy'])
    wishes = desired.values[:, :, axes].reshape(len(desired.stamps_ns), -1, len(robots), 2)
    ticks = desired.stamps_ns
    _, planned_ticks, plans = np.intersect1d(ticks, plan.stamps_ns, return_indices=True)
    if not len(plans):
        raise BagError(f'{PLAN} and {DESIRED} have no stamp in common')
    _, here, _ = np.intersect1d(ticks, motions.stamps_ns, return_indices=True)
    here = here[here >= planned_ticks[0]]
    latest = np.searchsorted(planned_ticks, here, side='right') - 1
    begin = planned_ticks[latest]
    planned = plan.values[plans[latest]][:, :, plan.columns(robots)].transpose(0, 2, 1)
    rule = timing_of(scenario).tick_ns, run.longest_gap
    place, velocity = planned[..., 0:2], planned[..., 7:9]
    place, velocity = carried(place, velocity, wishes[:, 0], ticks, (begin, here), rule)
    held = wishes[here, EFFORT, :, 0] > 0.5
    scene = Scene(ticks[here], robots, place, velocity, wishes[here, VELOCITY], held)
    frozen = np.zeros(held.shape, dtype=np.bool_)
    for k, robot in enumerate(scenario.robots):
        if robot.name in motions.robots:
            frozen[:, k] = _measure_frozen(scene, k, robot.gait == 'stand', motions, geometry)
    base = np.minimum(np.searchsorted(here, begin), len(here) - 1)
    jumps = frozen.any(axis=1) | frozen[base].any(axis=1)
    return scene.part((begin == here) | ~jumps)


def _measure_frozen(
    scene: Scene, k: int, stands: bool, motions: Motions, geometry: Centres
) -> NDArray[np.bool_]:
    """Put in the measured CoM velocity where a plan is frozen; return where that is, (K,).

    A robot that only stands is always held; its plan is frozen where it stands exactly
    at the measured CoM.
    """
    frozen = scene.held[:, k].copy()
    if not frozen.any():
        return frozen
    name = scene.robots[k]
    states = np.searchsorted(motions.stamps_ns, scene.stamps_ns)
    configurations = motions.robots[name][states]
    if stands:
        apart = scene.position[:, k] - geometry.centres_of_mass(configurations)[:, :2]
        frozen &= np.abs(apart).max(axis=1) < SAME_PLACE
    for row in np.flatnonzero(frozen):
        velocity = motions.velocities[name][states[row]]
        scene.velocity[row, k] = geometry.com_velocity(configurations[row], velocity)[:2]
    return frozen


def _needed(evidence: Evidence, topic: str) -> Trace:
    if topic not in evidence.traces:
        raise BagError(f'no {topic}')
    return evidence.traces[topic]
