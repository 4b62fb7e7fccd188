"""Stamps of the control path: their order, what is missing between them, and jitter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.evidence import COMMANDS, FORCES, Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_most, told
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import timing_of
from layered_cbf_ros.bags.audit.trace import Trace
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import (
    BARRIERS,
    DESIRED,
    DETECTIONS,
    PLAN,
    STATE,
    TRACKED,
    TRUTH,
    cmd_vel_safe,
    odometry,
)
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import REAL_TIME, InputRules


@dataclass(frozen=True, slots=True)
class Need:
    """The stamps that a topic must have: one a period, from the first state on.

    Attributes:
        topic: Its name.
        period_ns: [ns].
        last_ns: The last stamp on which anything in the bag depends [ns].
        plant: Whether the plant itself sends it, which misses no tick in real time either.
    """

    topic: str
    period_ns: int
    last_ns: int
    plant: bool = False


def check_order(evidence: Evidence) -> list[Check]:
    """Check that new stamps only grow, and that what is sent again is the same."""
    late, changed, notes = [], [], []
    for topic, trace in evidence.traces.items():
        if trace.disorder:
            stamps_ns, behind_ns = np.array(trace.disorder, dtype=np.int64).T
            times = evidence.seconds(stamps_ns)
            late.append(Samples(topic, times, behind_ns / NS_PER_S, 0.0))
        for stamp_ns in trace.contradictions:
            times = evidence.seconds(np.array([stamp_ns]))
            changed.append(Samples(topic, times, np.ones(1), 0.0))
        if trace.repeated:
            notes.append(f'{topic}: {trace.repeated} messages were sent again, unchanged')
    return [
        at_most('message after a later one', 's', late, (), notes),
        at_most('stamp with two contents', '', changed),
    ]


def check_presence(evidence: Evidence, limits: Limits) -> Check:
    """Check that no message is missing; in real time, that no topic is silent for long.

    In lockstep every stamp must be there, for the run waited for each of them: a stamp
    that is absent was lost by who recorded. In real time that holds for the plant only.
    """
    scenario = evidence.scenario
    if scenario is None or STATE not in evidence.traces:
        return Check('missing messages', '', '', holes=('what should be there is not known',))
    real_time = scenario.time == REAL_TIME
    holes, silences = [], []
    for need in _needs(evidence, scenario):
        trace = evidence.traces.get(need.topic)
        if trace is None:
            holes.append(f'no {need.topic}')
            continue
        stamps = trace.series.stamps_ns
        if need.plant or not real_time:
            absent = _absent(evidence.start_ns, need, stamps)
            if len(absent):
                holes.append(_described(evidence, need.topic, absent))
        elif real_time:
            ends = np.concatenate(([evidence.start_ns], stamps, [need.last_ns]))
            gaps = np.maximum(np.diff(ends), 0) / NS_PER_S
            silences.append(Samples(need.topic, evidence.seconds(ends[1:]), gaps, limits.silence))
    holes += [*_absent_tracks(evidence), *_absent_start(evidence)]
    if real_time:
        return at_most('silence of a topic', 's', silences, holes)
    return Check('missing messages', '', '', holes=tuple(holes))


def check_jitter(evidence: Evidence, limits: Limits) -> Check:
    """Check, in real time, that messages were logged as evenly as their stamps say.

    In lockstep the wall time between messages means nothing; its spread is told. What
    the coordinator tells of itself comes in batches and isn't judged.
    """
    scenario = evidence.scenario
    real_time = scenario is not None and scenario.time == REAL_TIME
    samples = []
    for topic, trace in evidence.traces.items():
        if topic in (BARRIERS, DESIRED):
            continue
        new = np.concatenate(([True], np.diff(trace.stamps_ns) > 0))
        stamps, logged = trace.stamps_ns[new], trace.logged_ns[new]
        if len(stamps) < 2:
            continue
        apart = np.diff(logged)
        usual = np.diff(stamps) if real_time else np.median(apart)
        values = np.abs(apart - usual) / NS_PER_S
        samples.append(Samples(topic, evidence.seconds(stamps[1:]), values, limits.jitter))
    if real_time:
        return at_most('jitter of log time', 's', samples)
    return told('jitter of log time', 's', samples)


def _needs(evidence: Evidence, scenario: Scenario) -> Iterator[Need]:
    """Yield what a run of this scenario must have sent, for the checks to prove anything."""
    timing = timing_of(scenario)
    rules, tick, plan = InputRules(timing), timing.tick_ns, timing.plan_ns
    last = int(evidence.traces[STATE].series.stamps_ns[-1])
    yield Need(STATE, tick, last, plant=True)
    if evidence.has_bases:
        for robot in scenario.robots:
            yield Need(odometry(robot.name), tick, last, plant=True)
            yield Need(cmd_vel_safe(robot.name), tick, rules.command.wanted(last) or 0)
    yield Need(PLAN, plan, rules.plan.wanted(last) or 0)
    yield Need(DESIRED, tick, last - tick)
    if len(scenario.robots) > 1 or scenario.walls:  # else they begin with the first track
        yield Need(BARRIERS, tick, last - tick)
    for robot in () if evidence.has_bases else scenario.robots:
        yield Need(f'/{robot.name}/{COMMANDS}', tick, rules.command.wanted(last) or 0)
        yield Need(f'/{robot.name}/{FORCES}', plan, rules.forces.wanted(last) or 0)
    if scenario.obstacles:
        yield Need(TRUTH, timing.detection_ns, last, plant=True)
        for topic in (DETECTIONS, TRACKED):
            yield Need(topic, timing.detection_ns, rules.tracks.wanted(last) or 0)


def _absent(start_ns: int, need: Need, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the stamps that should be there and are not [ns]."""
    first = -(-start_ns // need.period_ns) * need.period_ns
    expected = np.arange(first, need.last_ns + 1, need.period_ns, dtype=np.int64)
    return np.setdiff1d(expected, stamps)


def _described(evidence: Evidence, topic: str, absent: NDArray[np.int64]) -> str:
    first, last = evidence.seconds(absent[[0, -1]])
    if len(absent) == 1:
        return f'{topic}: the message of {first:.3f} s is missing'
    return f'{topic}: {len(absent)} messages between {first:.3f} and {last:.3f} s are missing'


def _absent_tracks(evidence: Evidence) -> list[str]:
    """Return, where fewer tracks were recorded than were announced, how many are missing."""
    trace: Trace | None = evidence.traces.get(TRACKED)
    if trace is None:
        return []
    announced = (~np.isnan(trace.series.values[:, 0])).sum(axis=1)
    found = np.zeros(len(announced), dtype=np.int64)
    for track in evidence.tracks().values():
        found += np.isin(trace.series.stamps_ns, track.series.stamps_ns)
    lacking = np.maximum(announced - found, 0)
    if not lacking.any():
        return []
    first = evidence.seconds(trace.series.stamps_ns[lacking > 0][:1])[0]
    return [f'{lacking.sum()} tracks that were announced are missing, first at {first:.3f} s']


def _absent_start(evidence: Evidence) -> list[str]:
    """Return whether something was computed from a state before the first recorded one."""
    earlier = [
        int(trace.stamps_ns.min())
        for topic, trace in evidence.traces.items()
        if topic != STATE and trace.stamps_ns.min() < evidence.start_ns
    ]
    if not earlier:
        return []
    before = (evidence.start_ns - min(earlier)) / NS_PER_S
    return [f'{STATE}: what was computed {before:.3f} s before the first state is in the bag']
