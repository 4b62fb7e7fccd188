"""When each foot swings, and where it lands. The paper is silent on both.

A trot between two moments, standing before and after: every question is a pure
function of the stamp asked for, so skipped ticks change nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.interfaces import NS_PER_S, Array

FOREVER_NS = 2**62
# FL and RR swing first, FR and RL half a period later.
HALF_PERIODS_LATE = np.array([0, 1, 1, 0])


@dataclass(frozen=True, slots=True)
class GaitState:
    """The robot trots from begin to end, and stands at any other time.

    Attributes:
        begin_ns: Stamp of the first lift-off [ns].
        end_ns: Stamp at which the last swing has landed [ns]; FOREVER_NS if open.
    """

    begin_ns: int
    end_ns: int


class Gait:
    """A trot of given period and duty.

    Args:
        parameters: Of the middle layer.
    """

    def __init__(self, parameters: GroundForceParameters) -> None:
        half_ns = round(0.5 * parameters.gait_period * NS_PER_S)
        self._period_ns = 2 * half_ns
        self._swing_ns = min(half_ns, round((1.0 - parameters.duty) * self._period_ns))
        self._half_ns = half_ns
        self._late_ns = HALF_PERIODS_LATE * half_ns
        self._stand_ns = round(parameters.stand_time * NS_PER_S)

    @property
    def swing_time(self) -> float:
        """Return how long a foot is in the air [s]."""
        return self._swing_ns / NS_PER_S

    @property
    def stance_time(self) -> float:
        """Return how long a foot stands in a trot [s]."""
        return (self._period_ns - self._swing_ns) / NS_PER_S

    def start(self, stamp_ns: int) -> GaitState:
        """Return a gait that stands a while, then trots."""
        return GaitState(stamp_ns + self._stand_ns, FOREVER_NS)

    def advance(self, state: GaitState, stamp_ns: int, stand: bool) -> GaitState:
        """Take the wish to stand or to trot into account.

        Args:
            state: The gait so far.
            stamp_ns: Present stamp [ns].
            stand: Whether to stand after the swing that is under way.
        """
        if stand and stamp_ns <= state.begin_ns:
            return GaitState(state.begin_ns, state.begin_ns)
        if stand and state.end_ns == FOREVER_NS:
            return GaitState(state.begin_ns, self._landing_after(state, stamp_ns))
        if stand or state.end_ns == FOREVER_NS:
            return state
        begin_ns = state.begin_ns if stamp_ns < state.end_ns else stamp_ns
        return GaitState(begin_ns, FOREVER_NS)

    def in_stance(self, state: GaitState, stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Tell which feet stand at which stamps; (n,) to (n, 4)."""
        trotting = (stamps_ns >= state.begin_ns) & (stamps_ns < state.end_ns)
        since_ns = (stamps_ns[:, None] - state.begin_ns - self._late_ns) % self._period_ns
        return (since_ns >= self._swing_ns) | ~trotting[:, None]

    def swing(self, state: GaitState, stamp_ns: int) -> tuple[Array, Array]:
        """Return swing phase in [0, 1) and its rate [1/s] of each foot, (4,) and (4,).

        Both are 0 in stance.
        """
        if not state.begin_ns <= stamp_ns < state.end_ns:
            return np.zeros(4), np.zeros(4)
        since_ns = (stamp_ns - state.begin_ns - self._late_ns) % self._period_ns
        swings = since_ns < self._swing_ns
        phase = np.where(swings, since_ns / self._swing_ns, 0.0)
        return phase, np.where(swings, NS_PER_S / self._swing_ns, 0.0)

    def _landing_after(self, state: GaitState, stamp_ns: int) -> int:
        """Return when the swing under way lands, or the stamp if all feet stand [ns]."""
        since = (stamp_ns - state.begin_ns) % self._half_ns
        return stamp_ns + max(0, self._swing_ns - since)


def touch_downs(
    position: Array,
    velocity: Array,
    correction: Array,
    yaw: float,
    yaw_rate: float,
    hip_offsets: Array,
    time_left: Array,
    half_stance: float,
    height: float,
) -> Array:
    """Return where each foot would land: below its hip at the middle of the next stance.

    p = c + v (t_rem + T_st / 2) + R_z(yaw + yaw_rate (t_rem + T_st / 2)) hip
        + correction.

    Args:
        position, velocity: Of the CoM, world plane [m], [m/s], (2,).
        correction: Shift that makes up for tracking errors, world plane [m], (2,).
        yaw, yaw_rate: Heading [rad] and its planned rate [rad/s].
        hip_offsets: From the CoM, base frame [m], (4, 3).
        time_left: Until each foot lands [s], (4,).
        half_stance: Half of the time a foot stands [s].
        height: Of the landed toe sphere's centre above the ground z = 0 [m].

    Returns:
        Centres of the toe spheres, world [m], (4, 3).
    """
    x, y = (position + correction).tolist()
    x_rate, y_rate = velocity.tolist()
    feet = []
    for (hip_x, hip_y, _), left in zip(hip_offsets.tolist(), time_left.tolist(), strict=True):
        ahead = left + half_stance
        cos, sin = math.cos(yaw + yaw_rate * ahead), math.sin(yaw + yaw_rate * ahead)
        foot_x = x + ahead * x_rate + cos * hip_x - sin * hip_y
        foot_y = y + ahead * y_rate + sin * hip_x + cos * hip_y
        feet.append((foot_x, foot_y, height))
    return np.array(feet)
