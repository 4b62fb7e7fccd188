"""Poses of motion capture: late, sometimes wrong, sometimes missing.

A pose tells where the robot was. What it should have been then is remembered as dead
reckoning, the position without what was ever corrected: so what a pose tells is the
same whenever it arrives, and several that are on their way correct an error once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.perception.contact_aided_filter import (
    PLANE,
    POSITION,
    Belief,
    ContactAidedFilter,
)
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters

SPACING_NS = 5_000_000
"""Between two remembered positions [ns]: a walking robot's path is straight for as long."""


@dataclass(frozen=True, slots=True)
class ExternalPose:
    """Where a robot was seen from outside.

    Attributes:
        stamp_ns: When [ns].
        position: Of its base in the world [m], (3,).
        yaw: Its heading [rad].
    """

    stamp_ns: int
    position: Array
    yaw: float


@dataclass(frozen=True, slots=True)
class Past:
    """Where a robot was by dead reckoning.

    Attributes:
        stamp_ns: When [ns].
        position: In the plane [m], (2,).
        imu_yaw: Heading that its IMU told [rad].
    """

    stamp_ns: int
    position: Array
    imu_yaw: float


@dataclass(frozen=True, slots=True)
class PoseMemory:
    """What one tick hands to the next.

    Attributes:
        past: Where the robot was, oldest first.
        correction: All that the position was corrected by [m], (2,).
        yaw_offset: Heading in the world minus that of the IMU [rad].
        yaw_variance: Of the offset [rad^2].
        last_ns: Stamp of the last pose that was believed or an outlier, -1 before it [ns].
        outliers: How many came in a row.
        off: How far the last of them was off: x, y [m] and yaw [rad], (3,).
    """

    past: tuple[Past, ...]
    correction: Array
    yaw_offset: float
    yaw_variance: float
    last_ns: int = -1
    outliers: int = 0
    off: Array | None = None


class ExternalPoses:
    """Corrects what is believed by poses from outside."""

    def __init__(self, parameters: StateEstimatorParameters, filter_: ContactAidedFilter) -> None:
        """Keep the parameters, and the filter that takes corrections."""
        self._parameters, self._filter = parameters, filter_
        self._longest_ns = round(parameters.external_delay * NS_PER_S)

    def start(self, yaw_offset: float, seen: ExternalPose | None) -> PoseMemory:
        """Return the memory of a robot that begins.

        Args:
            yaw_offset: Heading in the world minus that of the IMU [rad].
            seen: The pose from outside that tells it, None if nothing but its place does.
        """
        p = self._parameters
        spread = p.start_yaw_spread if seen is None else p.external_yaw_noise
        last_ns = -1 if seen is None else seen.stamp_ns
        return PoseMemory((), np.zeros(2), yaw_offset, spread**2, last_ns)

    def remember(
        self, memory: PoseMemory, stamp_ns: int, dt: float, position: Array, imu_yaw: float
    ) -> PoseMemory:
        """Note where the robot is by now, and that its heading has drifted.

        Args:
            memory: Before.
            stamp_ns: Now [ns].
            dt: Time since the last tick [s].
            position: In the plane, as believed [m], (2,).
            imu_yaw: Heading that the IMU tells [rad].
        """
        variance = memory.yaw_variance + dt * self._parameters.yaw_drift**2
        past = memory.past
        if not past or stamp_ns - past[-1].stamp_ns >= SPACING_NS:
            first = 0
            while first + 1 < len(past) and past[first + 1].stamp_ns < stamp_ns - self._longest_ns:
                first += 1
            now = Past(stamp_ns, position - memory.correction, imu_yaw)
            past = (*past[first:], now)
        return replace(memory, past=past, yaw_variance=variance)

    def correct(
        self, memory: PoseMemory, belief: Belief, pose: ExternalPose
    ) -> tuple[PoseMemory, Belief, str]:
        """Return what is known after a pose arrived, and why it is refused, '' if it is not."""
        refusal = self._untimely(memory, pose)
        if refusal:
            return memory, belief, refusal
        then = _between(memory.past, pose.stamp_ns)
        error = pose.position[:2] - then.position - memory.correction
        yaw_error = _wrapped(pose.yaw - then.imu_yaw - memory.yaw_offset)
        off = np.append(error, yaw_error)
        outliers = self._outliers(memory, belief, off)
        memory = replace(memory, last_ns=pose.stamp_ns, outliers=outliers, off=off)
        if 0 < outliers < self._parameters.external_relock:
            return memory, belief, f'external pose is {_text(off)} off'
        return *self._corrected(memory, belief, error, yaw_error), ''

    def _corrected(
        self, memory: PoseMemory, belief: Belief, error: Array, yaw_error: float
    ) -> tuple[PoseMemory, Belief]:
        """Take a pose that is believed: position by the filter, heading by one of its own."""
        p, variance = self._parameters, memory.yaw_variance
        spread = max(
            variance + p.external_yaw_noise**2, variance * abs(yaw_error) / p.external_turn
        )
        turn = variance / spread * yaw_error
        turned = self._filter.turn(belief, turn)
        moved = self._filter.shift(turned, error, p.external_noise, p.external_step)
        change = (moved.mean - belief.mean)[POSITION, :2]
        memory = replace(
            memory,
            correction=memory.correction + change,
            yaw_offset=memory.yaw_offset + turn,
            yaw_variance=variance * (1.0 - variance / spread),
        )
        return memory, moved

    def _untimely(self, memory: PoseMemory, pose: ExternalPose) -> str:
        """Tell why a pose cannot be compared with what was, '' if it can."""
        if not memory.past or pose.stamp_ns < memory.past[0].stamp_ns:
            return 'external pose is too old; see external_delay'
        if pose.stamp_ns <= memory.last_ns:
            return 'external pose is not newer than the one before'
        if pose.stamp_ns > memory.past[-1].stamp_ns + SPACING_NS:
            return 'external pose is from the future; let the clocks agree'
        return ''

    def _outliers(self, memory: PoseMemory, belief: Belief, off: Array) -> int:
        """Return how many outliers there are in a row, this pose included; 0 if it is none.

        Those in a row agree: they are as far off as the one before them.
        """
        p = self._parameters
        known = belief.covariance[PLANE, POSITION, POSITION]
        spread = np.sqrt(
            (known + p.external_noise**2, memory.yaw_variance + p.external_yaw_noise**2)
        )
        reach = p.external_gate * spread[[0, 0, 1]]
        if not (np.abs(off) > reach).any():
            return 0
        noise = np.array([p.external_noise, p.external_noise, p.external_yaw_noise])
        alike = (
            memory.off is not None
            and (np.abs(off - memory.off) < 2.0 * p.external_gate * noise).all()
        )
        return memory.outliers + 1 if alike and memory.outliers else 1


def _between(past: tuple[Past, ...], stamp_ns: int) -> Past:
    """Return where the robot was at a stamp [ns], not before the first that is known."""
    after = next((k for k in range(len(past)) if past[k].stamp_ns >= stamp_ns), None)
    if after is None or after == 0:
        return past[-1 if after is None else 0]
    early, late = past[after - 1], past[after]
    share = (stamp_ns - early.stamp_ns) / (late.stamp_ns - early.stamp_ns)
    return Past(
        stamp_ns,
        early.position + share * (late.position - early.position),
        early.imu_yaw + share * _wrapped(late.imu_yaw - early.imu_yaw),
    )


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)


def _text(off: Array) -> str:
    return f'{float(np.hypot(off[0], off[1])):.3f} m and {math.degrees(off[2]):.1f} deg'
