"""How old the inputs were that acted at each state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.evidence import COMMANDS, FORCES, Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_most, not_proven
from layered_cbf_ros.bags.audit.run_parameters import RunParameters, timing_of
from layered_cbf_ros.bags.audit.trace import Trace
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.node_topics import PLAN, STATE, cmd_vel_safe
from layered_cbf_ros.scenario import BASES, Scenario
from layered_cbf_ros.timing import REAL_TIME, InputRule, InputRules

NAMES = ('command age', 'plan age', 'forces age')
LOCKSTEP_NOTE = 'in lockstep: of the stamp that the timing rule wants'
REAL_TIME_NOTE = 'of the newest sent before the state was sent'


@dataclass(frozen=True, slots=True)
class _Input:
    """One kind of input: its topic for each robot, its rule, and its limit [s]."""

    name: str
    topics: tuple[str, ...]
    rule: InputRule
    limit: float


def check_ages(evidence: Evidence, run: RunParameters | None) -> list[Check]:
    """Check the age of commands, plans and forces at every state.

    In lockstep the message of exactly the wanted stamp acts, so that it must be in the
    bag. In real time the newest acts; counted are those that were sent before the state
    was, so that what is told is no younger than what acted.
    """
    state, scenario = evidence.traces.get(STATE), evidence.scenario
    if run is None or scenario is None or state is None:
        return [not_proven(name, 'states or parameters are not known') for name in NAMES]
    real_time = scenario.time == REAL_TIME
    checks = []
    for kind in _inputs(scenario, run, real_time):
        samples, holes = [], []
        for topic in kind.topics:
            trace = evidence.traces.get(topic)
            if trace is None:
                holes.append(f'no {topic}')
            elif real_time:
                ages = _newest_ages(state, trace, evidence.start_ns)
                times = evidence.seconds(np.sort(state.stamps_ns))
                samples.append(Samples(topic, times, ages, kind.limit))
            else:
                stamps, ages, absent = _wanted_ages(state, trace, kind.rule)
                samples.append(Samples(topic, evidence.seconds(stamps), ages, kind.limit))
                if absent:
                    holes.append(f'{topic}: what acted at {absent} states is not in the bag')
        note = REAL_TIME_NOTE if real_time else LOCKSTEP_NOTE
        checks.append(at_most(kind.name, 's', samples, holes, [note]))
    return checks


def _inputs(scenario: Scenario, run: RunParameters, real_time: bool) -> Iterator[_Input]:
    rules = InputRules(timing_of(scenario))
    tick_ns = timing_of(scenario).tick_ns
    robots = [robot.name for robot in scenario.robots]
    has_legs = scenario.plant != BASES
    commands = tuple(f'/{r}/{COMMANDS}' if has_legs else cmd_vel_safe(r) for r in robots)
    forces = tuple(f'/{robot}/{FORCES}' for robot in robots)
    kinds = (
        ('command age', commands, rules.command, run.command_age),
        ('plan age', (PLAN,), rules.plan, run.plan_age),
        ('forces age', forces, rules.forces, run.forces_age),
    )
    for name, topics, rule, limit in kinds if has_legs else kinds[:1]:
        oldest = (rule.latency_ns + rule.period_ns - tick_ns) / NS_PER_S
        yield _Input(name, topics, rule, limit if real_time else oldest)


def _wanted_ages(
    state: Trace, trace: Trace, rule: InputRule
) -> tuple[NDArray[np.int64], Array, int]:
    """Return states and the ages [s] of what acted there, and how many lack it."""
    stamps = state.series.stamps_ns
    wanted = (stamps - rule.latency_ns) // rule.period_ns * rule.period_ns
    known = wanted >= stamps[0]
    stamps, wanted = stamps[known], wanted[known]
    there = np.isin(wanted, trace.series.stamps_ns)
    ages = (stamps[there] - wanted[there]) / NS_PER_S
    return stamps[there], ages, int(np.sum(~there))


def _newest_ages(state: Trace, trace: Trace, start_ns: int) -> Array:
    """Return the age at each state of the newest input sent before it [s], (k,).

    Until there is one, the time since the first state counts.
    """
    order = np.argsort(trace.sent_ns, kind='stable')
    newest = np.maximum.accumulate(trace.stamps_ns[order])
    by_stamp = np.argsort(state.stamps_ns, kind='stable')
    before = np.searchsorted(trace.sent_ns[order], state.sent_ns[by_stamp], side='right')
    stamps = np.where(before > 0, newest[np.maximum(before - 1, 0)], start_ns)
    ages: Array = (state.stamps_ns[by_stamp] - stamps) / NS_PER_S
    return ages
