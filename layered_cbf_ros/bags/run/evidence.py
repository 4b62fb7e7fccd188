"""What a bag must contain before its figures prove anything."""

from __future__ import annotations

import itertools

import numpy as np

from layered_cbf_ros.bags.recording.losses import REFUSED_NOTE, read_losses
from layered_cbf_ros.bags.run import measures
from layered_cbf_ros.bags.run.message_form import EFFORT, POSITION
from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.bags.storage.writer import FAILED_NOTE
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import (
    CLEARANCE,
    DIAGNOSTICS,
    PER_ROBOT,
    PLAN,
    SCENARIO,
    STATE,
    TRUTH,
)
from layered_cbf_ros.run_nodes import node_names
from layered_cbf_ros.scenario import BASES, Scenario

LONGEST_GAP = 0.1
"""Longest time without a message of a topic that proves something [s]."""
ESTIMATED_AFTER_NS = 2 * NS_PER_S
"""A robot that a driver has stood up is at rest, and known, so much later [ns]."""


def missing_evidence(record: RunRecord) -> list[str]:
    """Return, in sentences, what the bag lacks; nothing if it is complete."""
    reasons = []
    if record.truncated:
        reasons.append('the bag is cut off: what happened after its end is not known')
    for topic, count in record.unreadable.items():
        reasons.append(f'{count} messages of {topic} cannot be decoded')
    if record.scenario is None:
        reasons.append(f'no {SCENARIO}: what was run, and which goals, is not known')
    else:
        reasons += _missing_bodies(record, record.scenario)
        reasons += _missing_nodes(record, record.scenario)
    return reasons + _told_losses(record) + _doubtful_state(record) + _missing_topics(record)


def _told_losses(record: RunRecord) -> list[str]:
    """Return what the recorder itself says that it lost, or could not record."""
    try:
        losses = read_losses(record.notes) or {}
    except BagError as error:
        return [str(error)]
    refused = record.notes.get(REFUSED_NOTE, {})
    failed = [f'the recorder failed: {why}' for why in record.notes.get(FAILED_NOTE, {}).values()]
    return (
        failed
        + [
            f'the recorder lost {told.lost} messages of {topic}'
            for topic, told in losses.items()
            if told.lost
        ]
        + [f'{topic} was not recorded: {reason}' for topic, reason in refused.items()]
    )


def _missing_topics(record: RunRecord) -> list[str]:
    """Check that what is measured was recorded all the time."""
    needed = {PLAN: (record.plan, 'the plan error'), CLEARANCE: (record.clearance, 'no contact')}
    reasons = []
    for topic, (series, what) in needed.items():
        if series is None:
            reasons.append(f'no {topic}: {what} is not proven')
        elif record.state is not None:
            last_ns = int(record.state.stamps_ns[-1])
            first_ns = _planned_from(record) if topic == PLAN else record.start_ns
            gap = measures.longest_gap(series, min(first_ns, last_ns), last_ns)
            if gap > LONGEST_GAP:
                reasons.append(f'{topic} is silent for {gap:.2f} s: {what} is not proven')
    return reasons


def _planned_from(record: RunRecord) -> int:
    """Return when there must be a plan [ns]: soon after the first robot stands."""
    stood = [measures.stood_up_ns(record, motion) for motion in record.motions.values()]
    first_ns = min(stood, default=record.start_ns)
    return first_ns + ESTIMATED_AFTER_NS if first_ns > record.start_ns else first_ns


def _doubtful_state(record: RunRecord) -> list[str]:
    state, where = record.state, _told_by(record)
    if state is None:
        return [f'no {where}: nothing is proven']
    reasons = []
    if not np.isfinite(state.values).all():
        reasons.append(f'{where} has values that are not finite')
    if state.contradictions:
        reasons.append(f'{where} has {state.contradictions} stamps with two different states')
    missing = measures.missing_states(state)
    if missing:
        reasons.append(f'{missing} messages of {where} are missing')
    return reasons


def _told_by(record: RunRecord) -> str:
    """Return what tells where the robots are."""
    scenario = record.scenario
    return 'odometry' if scenario is not None and scenario.plant == BASES else STATE


def _missing_bodies(record: RunRecord, scenario: Scenario) -> list[str]:
    """Check that every body and every pair of bodies was recorded."""
    robots = [robot.name for robot in scenario.robots]
    where = _told_by(record)
    reasons = [f'{where} has no robot {name}' for name in robots if name not in record.motions]
    expected = len(scenario.obstacles)
    found = 0 if record.obstacles is None else record.obstacles.positions.shape[1]
    if expected != found:
        reasons.append(f'{TRUTH} has {found} obstacles, the scenario {expected}')
    if record.clearance is None:
        return reasons
    others = [obstacle.name for obstacle in scenario.obstacles]
    others += [wall.name for wall in scenario.walls]
    others += ['ground'] if scenario.plant != BASES else []
    pairs = [f'{a}~{b}' for a, b in itertools.combinations(robots, 2)]
    pairs += [f'{robot}~{other}' for robot in robots for other in others]
    for pair in pairs:
        if pair not in record.clearance.names:
            reasons.append(f'{CLEARANCE} has no pair {pair}')
            continue
        column = record.clearance.names.index(pair)
        if np.isnan(record.clearance.values[:, (POSITION, EFFORT), column]).any():
            reasons.append(f'{CLEARANCE} does not always tell {pair}')
    return reasons


def _missing_nodes(record: RunRecord, scenario: Scenario) -> list[str]:
    """Check that every controller told how its solver fared."""
    solving = ('coordinator', *PER_ROBOT)
    nodes = [n for n in node_names(scenario, record=False) if n.rpartition('/')[2] in solving]
    return [
        f'no {DIAGNOSTICS} of {node}: its solver failures are not known'
        for node in nodes
        if node not in record.counters
    ]
