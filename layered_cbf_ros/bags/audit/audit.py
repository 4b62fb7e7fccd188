"""The audit of one bag: all checks, and what follows from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.bags.audit.age_checks import check_ages
from layered_cbf_ros.bags.audit.barrier_checks import check_barriers
from layered_cbf_ros.bags.audit.bases import DiscGeometry, check_disc_clearance
from layered_cbf_ros.bags.audit.body_checks import (
    check_commands,
    check_joints,
    check_plan_error,
    check_posture,
)
from layered_cbf_ros.bags.audit.body_geometry import BodyGeometry, Centres
from layered_cbf_ros.bags.audit.clearance import check_clearance
from layered_cbf_ros.bags.audit.completeness import check_completeness
from layered_cbf_ros.bags.audit.distances import check_distances
from layered_cbf_ros.bags.audit.evidence import Evidence, gather
from layered_cbf_ros.bags.audit.findings import BREACH, NOT_PROVEN, OK, Check, not_proven
from layered_cbf_ros.bags.audit.force_checks import check_forces
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.plan_checks import check_plan
from layered_cbf_ros.bags.audit.run_parameters import RunParameters, parameters_of
from layered_cbf_ros.bags.audit.stamp_checks import check_jitter, check_order, check_presence
from layered_cbf_ros.bags.audit.world import Motions, motions_of
from layered_cbf_ros.bags.command_line import EXIT_BAD_INPUT, EXIT_FOUND
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.errors import BagError, LayeredCbfError

Groups = list[tuple[str, Callable[[], Check | list[Check]]]]


@dataclass(frozen=True)
class Audit:
    """What was found in one bag.

    Attributes:
        bag: The bag.
        scenario: Name of what was run, '' if that isn't known.
        duration_s: Time from the first state to the last [s].
        limits: What had to be kept.
        checks: All of them.
    """

    bag: str
    scenario: str
    duration_s: float
    limits: Limits
    checks: tuple[Check, ...]

    @property
    def status(self) -> str:
        """Return BREACH if there is one, else NOT_PROVEN if there is a hole, else OK."""
        found = {check.status for check in self.checks}
        return next((status for status in (BREACH, NOT_PROVEN) if status in found), OK)

    @property
    def exit_code(self) -> int:
        """Return 0 if all is proven and kept, 1 for a breach, 2 if not all is proven."""
        return {OK: 0, BREACH: EXIT_FOUND, NOT_PROVEN: EXIT_BAD_INPUT}[self.status]


def audit(path: Path, limits: Limits | None = None) -> Audit:
    """Recompute from a bag whether its run kept its promises.

    Args:
        path: An mcap or db3 file, a bag's folder, or a run's folder.
        limits: What it must keep beyond what its scenario says.

    Raises:
        BagError: If there is no bag, or no message in it.
    """
    bag = open_bag(path)
    evidence = gather(bag)
    if not evidence.counts:
        raise BagError(f'{path} holds no message that is whole; nothing can be audited')
    limits = limits or Limits()
    run, reason = _parameters(evidence)
    motions = motions_of(evidence)
    centres: Centres = DiscGeometry() if evidence.has_bases else BodyGeometry()
    groups: Groups = [
        ('completeness', lambda: check_completeness(evidence, bag.files, reason)),
        ('missing messages', lambda: check_presence(evidence, limits)),
        ('order of stamps', lambda: check_order(evidence)),
        ('jitter', lambda: check_jitter(evidence, limits)),
        ('ages', lambda: check_ages(evidence, run)),
        ('centre distance', lambda: check_distances(evidence, motions, run, limits)),
        ('barriers', lambda: check_barriers(evidence, motions, centres, run, limits)),
        ('plan', lambda: check_plan(evidence, run, limits)),
        ('plan error', lambda: check_plan_error(evidence, motions, centres, limits)),
        *_body_groups(evidence, motions, run, limits, centres),
    ]
    checks = [check for name, group in groups for check in _checked(name, group)]
    duration_s = float(motions.times[-1]) if len(motions.times) else 0.0
    name = '' if evidence.scenario is None else evidence.scenario.name
    return Audit(str(path), name, duration_s, limits, tuple(checks))


def _body_groups(
    evidence: Evidence,
    motions: Motions,
    run: RunParameters | None,
    limits: Limits,
    centres: Centres,
) -> Groups:
    """Return the checks of what the robots are made of."""
    if not isinstance(centres, BodyGeometry):
        return [('clearance', lambda: check_disc_clearance(evidence, motions, run, limits))]
    return [
        ('clearance', lambda: check_clearance(evidence, motions, centres, limits)),
        ('posture', lambda: check_posture(evidence, motions, limits)),
        ('joints', lambda: check_joints(motions, centres, limits)),
        ('commands', lambda: check_commands(evidence, run, limits)),
        ('ground forces', lambda: check_forces(evidence, run, limits)),
    ]


def _parameters(evidence: Evidence) -> tuple[RunParameters | None, str | None]:
    """Return the parameters of the run, or why they are not known."""
    if evidence.scenario is None:
        return None, None
    try:
        return parameters_of(evidence.scenario), None
    except LayeredCbfError as error:
        return None, str(error)


def _checked(name: str, group: Callable[[], Check | list[Check]]) -> list[Check]:
    """Return the checks of a group; one that lacks what it needs proves nothing."""
    try:
        checks = group()
    except LayeredCbfError as error:
        return [not_proven(name, str(error))]
    return checks if isinstance(checks, list) else [checks]
