"""The verdict on a run, from its bag alone.

What isn't in the bag isn't proven, and what isn't proven isn't passed.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from layered_cbf_ros.bags.json_output import finite
from layered_cbf_ros.bags.run import measures
from layered_cbf_ros.bags.run.checks import Check, Limits, RunFigures, compare, format_table
from layered_cbf_ros.bags.run.distances import pair_distances
from layered_cbf_ros.bags.run.evidence import missing_evidence
from layered_cbf_ros.bags.run.run_record import RunRecord, load_run
from layered_cbf_ros.bags.run.stops import emergency_stops
from layered_cbf_ros.interfaces import NS_PER_S


@dataclass(frozen=True)
class Verdict(RunFigures):
    """Figures of a run and the judgement on them.

    Attributes:
        passed: Whether all is proven and kept.
        reasons: Why it isn't passed, in sentences; empty if it is.
        checks: The lines of the table.
    """

    passed: bool
    reasons: tuple[str, ...]
    checks: tuple[Check, ...]

    def to_json(self) -> dict[str, Any]:
        """Return all but the table as plain values for json.dumps; NaN becomes None."""
        values = dataclasses.asdict(self)
        del values['checks']
        plain: dict[str, Any] = finite(values)
        return plain

    def table(self) -> str:
        """Return the figures, what they must be, and the judgement, as aligned text."""
        judgement = 'PASSED' if self.passed else 'NOT PASSED'
        reasons = [f'  - {reason}' for reason in self.reasons]
        return '\n'.join([*format_table(self.checks), '', judgement, *reasons])


def judge(bag: Path, limits: Limits | None = None, wall_time_s: float | None = None) -> Verdict:
    """Return the verdict on a bag.

    Args:
        bag: An mcap file, a bag's folder or a run's folder.
        limits: What the run must keep.
        wall_time_s: Wall-clock time of the run; by default the time between the
            recording of its first and its last state [s].

    Raises:
        BagError: If there is no bag.
    """
    return judge_record(load_run(bag), limits, wall_time_s)


def judge_record(
    record: RunRecord, limits: Limits | None = None, wall_time_s: float | None = None
) -> Verdict:
    """Return the verdict on a run that is loaded already, see `judge`."""
    figures = measure(record, wall_time_s)
    tolerance = 0.0 if record.scenario is None else record.scenario.goal_tolerance
    checks = compare(figures, limits or Limits(), tolerance)
    reasons = [f'{c.figure}: {c.value}, must be {c.must}' for c in checks if c.kept is False]
    reasons += missing_evidence(record)
    values = {field.name: getattr(figures, field.name) for field in dataclasses.fields(figures)}
    return Verdict(**values, passed=not reasons, reasons=tuple(reasons), checks=tuple(checks))


def measure(record: RunRecord, wall_time_s: float | None = None) -> RunFigures:
    """Return the figures of a run, not judged; wall_time_s as in `judge`."""
    state, scenario = record.state, record.scenario
    first, last = record.wall_span_ns
    wall = (last - first) / NS_PER_S if wall_time_s is None else wall_time_s
    sim = None if state is None else float(record.seconds(state.stamps_ns[-1:])[0])
    goals = {} if scenario is None else measures.goal_times(record, scenario)
    reached = [time for time in goals.values() if time is not None]
    nearest = min(pair_distances(record), key=lambda pair: pair.margin, default=None)
    clearance = measures.smallest_clearance(record)
    roll, pitch, torque = _extremes(record)
    falls, contacts = measures.find_falls(record), measures.find_contacts(record)
    stops = emergency_stops(record)
    return RunFigures(
        bag=str(record.path),
        scenario=None if scenario is None else scenario.name,
        seed=None if scenario is None else scenario.seed,
        sim_time_s=sim,
        wall_time_s=wall,
        real_time_factor=sim / wall if sim is not None and wall > 0.0 else None,
        goals_reached_s=goals,
        goal_reached_s=max(reached) if reached and len(reached) == len(goals) else None,
        min_distance_m=None if nearest is None else nearest.smallest,
        min_distance_pair=None if nearest is None else nearest.label,
        promised_distance_m=None if nearest is None else nearest.promised,
        min_clearance_m=None if clearance is None else clearance[0],
        min_clearance_pair=None if clearance is None else clearance[1],
        max_plan_error_m=measures.largest_plan_error(record),
        max_roll_deg=roll,
        max_pitch_deg=pitch,
        max_torque_nm=torque,
        e_stops=len(stops),
        e_stop_times_s=stops,
        falls=len(falls),
        contacts=len(contacts),
        fall_events=falls,
        contact_events=contacts,
        solver_failures=_total(record, 'solver_failures'),
        slack_events=_total(record, 'slack_events'),
        deadline_misses=_total(record, 'deadline_misses'),
        rejected=_total(record, 'rejected'),
        trajectory_sha256=None if state is None else measures.trajectory_sha256(state),
        messages=sum(record.counts.values()),
        topics=len(record.counts),
        truncated=record.truncated,
    )


def _total(record: RunRecord, counter: str) -> int:
    return sum(node[counter] for node in record.counters.values())


def _extremes(record: RunRecord) -> tuple[float | None, float | None, float | None]:
    """Return largest roll [deg], pitch [deg] and torque [Nm] of all robots."""
    if not record.motions:
        return None, None, None
    rolls, pitches, torques = [], [], []
    for motion in record.motions.values():
        roll, pitch, _ = measures.roll_pitch_tilt(motion.configurations[:, 3:7])
        rolls.append(np.abs(roll).max())
        pitches.append(np.abs(pitch).max())
        if motion.has_legs:
            torques.append(np.abs(motion.torques).max())
    roll_deg, pitch_deg = float(np.rad2deg(np.max(rolls))), float(np.rad2deg(np.max(pitches)))
    return roll_deg, pitch_deg, float(np.max(torques)) if torques else None
