"""Where every body was at each state: robots as recorded, obstacles between their stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.evidence import Evidence
from layered_cbf_ros.bags.audit.trace import Trace
from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.messages.robot_state import JOINTS, VELOCITIES, base_names, state_names
from layered_cbf_ros.node_topics import STATE, TRUTH

POSITION, VELOCITY, EFFORT = range(3)


@dataclass(frozen=True, slots=True)
class Motions:
    """All bodies at the stamps of /state.

    Attributes:
        stamps_ns: Stamps [ns], (k,).
        times: The same since the first state [s], (k,).
        robots, velocities: As in RobotState, by robot, (k, 19) and (k, 18); of bases their
            pose and twist, (k, 7) and (k, 6).
        torques: Measured joint torques, by robot [Nm], (k, 12) or (k, 0).
        obstacles: True centres in the plane, by obstacle [m], (k, 2).
        holes: What the bag doesn't tell of them, in sentences.
    """

    stamps_ns: NDArray[np.int64]
    times: Array
    robots: Mapping[str, Array]
    velocities: Mapping[str, Array]
    torques: Mapping[str, Array]
    obstacles: Mapping[str, Array]
    holes: tuple[str, ...]


def motions_of(evidence: Evidence) -> Motions:
    """Return where everybody was."""
    trace = evidence.traces.get(STATE)
    if trace is None:
        none = np.empty(0, dtype=np.int64)
        return Motions(none, np.empty(0), {}, {}, {}, {}, (f'no {STATE}',))
    state, holes = trace.series, []
    robots, velocities, torques = {}, {}, {}
    for name in evidence.robots:
        entries = base_names(name) if evidence.has_bases else state_names(name)
        if not set(entries) <= set(state.names):
            holes.append(f'{STATE} has no whole robot {name}')
            continue
        values = state.values[:, :, state.columns(entries)]
        robots[name] = np.ascontiguousarray(values[:, POSITION, : JOINTS.stop])
        velocities[name] = values[:, VELOCITY][:, VELOCITIES[len(entries) > VELOCITIES]]
        torques[name] = values[:, EFFORT, JOINTS].copy()
    obstacles, unknown = _obstacles(evidence, state)
    return Motions(
        state.stamps_ns,
        evidence.seconds(state.stamps_ns),
        robots,
        velocities,
        torques,
        obstacles,
        (*holes, *unknown),
    )


def _obstacles(evidence: Evidence, state: Series) -> tuple[dict[str, Array], list[str]]:
    """Return the obstacles' centres at the states, and what is not known of them."""
    expected = () if evidence.scenario is None else evidence.scenario.obstacles
    if not expected:
        return {}, []
    truth = evidence.traces.get(TRUTH)
    if truth is None:
        return {}, [f'no {TRUTH}: where the obstacles were is not known']
    if len(truth.series.names) != len(expected):
        found = len(truth.series.names)
        return {}, [f'{TRUTH} has {found} obstacles, the scenario {len(expected)}']
    positions = between(truth, state.stamps_ns)
    return {thing.name: positions[:, :, k] for k, thing in enumerate(expected)}, []


def between(truth: Trace, stamps_ns: NDArray[np.int64]) -> Array:
    """Return points at some stamps, on the line through the two that are around, (k, 2, n).

    Before the first and behind the last stamp the line goes on, which spans less than
    one period if no message is missing. On a path with acceleration a the line is off
    by a dt^2 / 8 at most: 2 micrometres at 10 ms and 0.16 m/s^2.
    """
    series = truth.series
    if len(series.stamps_ns) < 2:
        return np.repeat(series.values[:1], len(stamps_ns), axis=0)
    left = np.clip(
        np.searchsorted(series.stamps_ns, stamps_ns, side='right') - 1,
        0,
        len(series.stamps_ns) - 2,
    )
    start, end = series.stamps_ns[left], series.stamps_ns[left + 1]
    share = ((stamps_ns - start) / NS_PER_S) / ((end - start) / NS_PER_S)
    first = series.values[left]
    points: Array = first + share[:, None, None] * (series.values[left + 1] - first)
    return points
