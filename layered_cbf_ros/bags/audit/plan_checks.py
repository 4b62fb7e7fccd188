"""The planned motion by itself: is it the integral of its inputs, within its limits?"""

from __future__ import annotations

import numpy as np

from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_most, not_proven
from layered_cbf_ros.bags.audit.integration import carried
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import RunParameters, timing_of
from layered_cbf_ros.bags.audit.trace import Trace
from layered_cbf_ros.node_topics import DESIRED, PLAN
from layered_cbf_ros.scenario import Scenario

INTEGRAL, SPEED, ACCELERATION, YAW = (
    'plan is its integral', 'planned speed', 'planned acceleration', 'planned yaw rate',
)  # fmt: skip
PLACE, VELOCITY, INPUT, YAW_RATE = slice(0, 2), slice(7, 9), slice(13, 15), 12
EFFORT = 3


def check_plan(evidence: Evidence, run: RunParameters | None, limits: Limits) -> list[Check]:
    """Check the plan of every robot."""
    trace, names = evidence.traces.get(PLAN), (INTEGRAL, SPEED, ACCELERATION, YAW)
    if trace is None:
        return [not_proven(name, f'no {PLAN}') for name in names]
    if run is None or evidence.scenario is None:
        return [not_proven(name, 'its parameters are not known') for name in names]
    series, extra = trace.series, limits.plan_rounding
    times = evidence.seconds(series.stamps_ns)
    speeds, accelerations, turns = [], [], []
    holes = [f'{PLAN} has no robot {name}' for name in evidence.robots if name not in series.names]
    for k, name in enumerate(series.names):
        planned = series.values[:, :, k]
        speed = np.abs(planned[:, VELOCITY]).max(axis=1)
        speeds.append(Samples(name, times, speed, run.speed_limit + extra))
        acceleration = np.abs(planned[:, INPUT]).max(axis=1)
        accelerations.append(Samples(name, times, acceleration, run.acceleration_limit + extra))
        turn = np.abs(planned[:, YAW_RATE])
        turns.append(Samples(name, times, turn, run.yaw_rate_limit + extra))
    return [
        _check_integral(evidence, evidence.scenario, trace, run, limits),
        at_most(SPEED, 'm/s', speeds, holes, ['per world axis']),
        at_most(ACCELERATION, 'm/s^2', accelerations, holes, ['per world axis']),
        at_most(YAW, 'rad/s', turns, holes),
    ]


def _check_integral(
    evidence: Evidence, scenario: Scenario, plan: Trace, run: RunParameters, limits: Limits
) -> Check:
    """Check each planned point against the one before, carried on by the applied inputs.

    The acceleration that the plan tells must be the applied input, too.
    """
    desired = evidence.traces.get(DESIRED)
    if desired is None:
        return not_proven(INTEGRAL, f'no {DESIRED}')
    period_ns = timing_of(scenario).tick_ns
    ticks = desired.series.stamps_ns
    stamps, rows, begins = np.intersect1d(plan.series.stamps_ns, ticks, return_indices=True)
    samples, holes = [], []
    if len(stamps) < len(plan.series.stamps_ns):
        absent = len(plan.series.stamps_ns) - len(stamps)
        holes.append(f'{DESIRED} has nothing at {absent} stamps of {PLAN}')
    times = evidence.seconds(stamps)
    for k, name in enumerate(plan.series.names):
        columns = desired.series.columns([f'{name}/x', f'{name}/y'])
        wishes = desired.series.values[:, :, columns]
        planned = plan.series.values[rows, :, k]
        p, v = carried(
            planned[:-1, PLACE],
            planned[:-1, VELOCITY],
            wishes[:, 0],
            ticks,
            (begins[:-1], begins[1:]),
            (period_ns, run.longest_gap),
        )
        off = np.hstack((planned[1:, PLACE] - p, planned[1:, VELOCITY] - v))
        held = wishes[begins, EFFORT, 0] > 0.5
        free = ~(held[1:] | held[:-1])  # a frozen plan jumps to where its robot is
        other_input = np.abs(planned[1:, INPUT] - wishes[begins[1:], 0]).max(axis=1)
        apart = np.maximum(np.abs(off).max(axis=1), other_input)[free]
        samples.append(Samples(name, times[1:][free], apart, limits.plan_step))
    return at_most(INTEGRAL, 'm, m/s, m/s^2', samples, holes)
