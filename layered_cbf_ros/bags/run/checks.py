"""The figures of a run beside what they must be."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.bags.run.measures import Contact, Fall
from layered_cbf_ros.bags.tables import underlined


@dataclass(frozen=True, slots=True)
class Limits:
    """What a run must keep.

    Attributes:
        distance_slip: The promised centre distance may be missed by this, for the
            promise is about the planned CoM, not about the trunk's origin [m].
        plan_error: Largest distance of a CoM from its plan [m].
        tilt: Largest roll and pitch [deg].
        torque: Largest joint torque [Nm].
        solver_failures, slack_events: Most of these events.
    """

    distance_slip: float = 0.03
    plan_error: float = 0.1
    tilt: float = 30.0
    torque: float = 33.5
    solver_failures: int = 0
    slack_events: int = 0


@dataclass(frozen=True)
class RunFigures:
    """Figures of a run; None is what the bag doesn't tell.

    Attributes:
        goals_reached_s: When each robot with a goal first reached it [s].
        goal_reached_s: When the last did [s]; None unless all did.
        min_distance_m: Smallest distance between centres, of the pair with the
            least margin over promised_distance_m.
        promised_distance_m: Sum of that pair's radii.
        min_clearance_m: Smallest distance between surfaces; beyond the simulator's
            exact_within it is a lower bound.
        max_plan_error_m: Largest distance of a CoM from its plan in the plane.
        max_torque_nm: Largest torque of any joint, from the first state on.
        e_stops, e_stop_times_s: Emergency stops, and when each began.
        falls: Robots that fell; who sits down because he is told to has not.
        solver_failures, slack_events, deadline_misses, rejected: Sums over all nodes.
        trajectory_sha256: Hash of the motion, see measures.trajectory_sha256.
    """

    bag: str
    scenario: str | None
    seed: int | None
    sim_time_s: float | None
    wall_time_s: float
    real_time_factor: float | None
    goals_reached_s: dict[str, float | None]
    goal_reached_s: float | None
    min_distance_m: float | None
    min_distance_pair: str | None
    promised_distance_m: float | None
    min_clearance_m: float | None
    min_clearance_pair: str | None
    max_plan_error_m: float | None
    max_roll_deg: float | None
    max_pitch_deg: float | None
    max_torque_nm: float | None
    e_stops: int
    e_stop_times_s: tuple[float, ...]
    falls: int
    contacts: int
    fall_events: tuple[Fall, ...]
    contact_events: tuple[Contact, ...]
    solver_failures: int
    slack_events: int
    deadline_misses: int
    rejected: int
    trajectory_sha256: str | None
    messages: int
    topics: int
    truncated: bool


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the table; `kept` is None for a figure that is only told, or unknown."""

    figure: str
    value: str
    must: str = ''
    kept: bool | None = None


def compare(run: RunFigures, limits: Limits, goal_tolerance: float) -> list[Check]:
    """Return the lines of the table.

    Args:
        run: The figures.
        limits: What they must keep.
        goal_tolerance: Distance at which a goal counts as reached [m].
    """
    promised = run.promised_distance_m
    distance = None if promised is None else promised - limits.distance_slip
    falls = [f'{fall.robot} at {fall.time_s:.2f} s ({fall.reason})' for fall in run.fall_events]
    touches = [
        f'{hit.pair} at {hit.time_s:.2f} s, {hit.force_n:.0f} N' for hit in run.contact_events
    ]
    goals = [
        Check(f'{name} at goal', _text(t, 's', 2), f'within {goal_tolerance:g} m', t is not None)
        for name, t in run.goals_reached_s.items()
    ]
    times = ', '.join(f'{time:.2f} s' for time in run.e_stop_times_s)
    stops = [Check('emergency stops', f'{run.e_stops} (at {times})')] if times else []
    return [
        Check('scenario', run.scenario or '-'),
        Check('seed', '-' if run.seed is None else str(run.seed)),
        Check('simulated time', _text(run.sim_time_s, 's', 2)),
        Check('wall time', _text(run.wall_time_s, 's', 2)),
        Check('real-time factor', _text(run.real_time_factor, '', 3)),
        *goals,
        _at_least('smallest centre distance', run.min_distance_m, distance, run.min_distance_pair),
        _above_zero('smallest clearance', run.min_clearance_m, run.min_clearance_pair),
        _at_most('largest plan error', run.max_plan_error_m, limits.plan_error, 'm', 4),
        _at_most('largest roll', run.max_roll_deg, limits.tilt, 'deg', 2),
        _at_most('largest pitch', run.max_pitch_deg, limits.tilt, 'deg', 2),
        _at_most('largest torque', run.max_torque_nm, limits.torque, 'Nm', 1),
        *stops,
        Check('falls', '; '.join(falls) or '0', '0', not falls),
        Check('contacts', '; '.join(touches) or '0', '0', not touches),
        _at_most('solver failures', run.solver_failures, limits.solver_failures),
        _at_most('slack events', run.slack_events, limits.slack_events),
        Check('deadline misses', str(run.deadline_misses)),
        Check('rejected messages', str(run.rejected)),
        Check('messages, topics', f'{run.messages}, {run.topics}'),
        Check('trajectory sha256', (run.trajectory_sha256 or '-')[:16]),
    ]


def format_table(checks: tuple[Check, ...]) -> list[str]:
    """Return the checks as aligned lines below a heading."""
    marks = {True: 'ok', False: 'FAIL', None: ''}
    rows = [('figure', 'value', 'must', '')]
    rows += [(check.figure, check.value, check.must, marks[check.kept]) for check in checks]
    return underlined(rows)


def _text(value: float | None, unit: str, digits: int, note: str | None = None) -> str:
    if value is None:
        return '-'
    return f'{value:.{digits}f} {unit}'.rstrip() + (f' ({note})' if note else '')


def _at_most(
    figure: str, value: float | None, limit: float, unit: str = '', digits: int = 0
) -> Check:
    kept = None if value is None else value <= limit
    return Check(figure, _text(value, unit, digits), f'<= {limit:g} {unit}'.rstrip(), kept)


def _at_least(figure: str, value: float | None, limit: float | None, note: str | None) -> Check:
    if value is None or limit is None:
        return Check(figure, '-')
    return Check(figure, _text(value, 'm', 3, note), f'>= {limit:.3f} m', value >= limit)


def _above_zero(figure: str, value: float | None, note: str | None) -> Check:
    return Check(
        figure, _text(value, 'm', 3, note), '> 0 m', None if value is None else value > 0.0
    )
