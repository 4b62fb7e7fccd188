"""Which feet carry, by the gait, by their sensors, or by both.

The sensors are air bags: what they read at rest differs from foot to foot, drifts, and may
be negative. It is learned in each swing, and before the robot first stands if its feet
are in the air then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import LEGS, NS_PER_S, Array, GroundForcePlan, Measured
from layered_cbf_ros.perception.estimator_parameters import (
    FORCE,
    SCHEDULE,
    StateEstimatorParameters,
)

HIGH_UP = (0.3, 0.7)
"""Part of its swing in which a foot is surely in the air."""


@dataclass(frozen=True, slots=True)
class ContactMemory:
    """What one tick hands to the next.

    Attributes:
        readings: Smoothed readings of the feet, in the sensor's unit, (4,).
        at_rest: What they read in the air, (4,).
        tared: For how long it was averaged so far at the start [s].
        carrying: For how long each foot has carried [s], (4,).
    """

    readings: Array
    at_rest: Array
    tared: float
    carrying: Array

    @property
    def loads(self) -> Array:
        """Return what the feet read more than at rest, in the sensor's unit, (4,)."""
        return self.readings - self.at_rest


class FootContacts:
    """Tells how far each foot can be relied on."""

    def __init__(self, parameters: StateEstimatorParameters) -> None:
        """Keep the parameters."""
        self._parameters = parameters
        self._threshold = np.array(parameters.contact_threshold)

    def start(self, readings: Array) -> ContactMemory:
        """Return the memory of a robot of which nothing is known but one reading, (4,)."""
        settled = np.full(4, self._parameters.settling_time)
        return ContactMemory(readings, np.zeros(4), 0.0, settled)

    def step(
        self,
        memory: ContactMemory,
        dt: float,
        measured: Measured,
        plan: GroundForcePlan | None,
        lying: bool,
    ) -> tuple[ContactMemory, Array]:
        """Return what to remember, and how much each foot is believed to stand, (4,).

        Args:
            memory: From the last tick.
            dt: Time since then [s].
            measured: What the feet read.
            plan: The gait, a little older; None: all feet are to stand.
            lying: Whether nothing can be on the feet, because the robot has never stood.
        """
        p = self._parameters
        phase = _swing_phase(plan, measured.stamp_ns)
        share = 1.0 if dt >= p.force_smoothing else dt / p.force_smoothing
        readings = memory.readings + share * (measured.foot_forces - memory.readings)
        at_rest, tared = self._tare(memory, dt, measured.foot_forces, phase, lying)
        carries = self._carrying(readings - at_rest, phase)
        carrying = np.where(carries, memory.carrying + dt, 0.0)
        trust = np.clip(carrying / max(p.settling_time, 1e-9), 0.0, 1.0)
        return ContactMemory(readings, at_rest, tared, carrying), trust

    def unloaded(self, memory: ContactMemory) -> str:
        """Return the names of feet that carry nothing; who asks no sensors takes them to carry."""
        if self._parameters.contacts == SCHEDULE:
            return ''
        loaded = memory.loads > self._threshold
        return ' '.join(leg for leg, carries in zip(LEGS, loaded, strict=True) if not carries)

    def _carrying(self, loads: Array, phase: Array) -> NDArray[np.bool_]:
        contacts = self._parameters.contacts
        loaded, planned = loads > self._threshold, phase < 0.0
        if contacts == SCHEDULE:
            return planned
        return loaded if contacts == FORCE else loaded & planned

    def _tare(
        self, memory: ContactMemory, dt: float, readings: Array, phase: Array, lying: bool
    ) -> tuple[Array, float]:
        """Learn what the feet read in the air: of a robot that lies, and in each swing."""
        p = self._parameters
        if lying and dt > 0.0 and memory.tared < p.tare_time:
            tared = memory.tared + dt
            share = dt / tared
            return memory.at_rest + share * (readings - memory.at_rest), tared
        up = (phase > HIGH_UP[0]) & (phase < HIGH_UP[1])
        share = min(1.0, dt / p.tare_time)
        return memory.at_rest + share * up * (readings - memory.at_rest), memory.tared


def _swing_phase(plan: GroundForcePlan | None, stamp_ns: int) -> Array:
    """Return the done part of each foot's swing now, -1 in stance, (4,)."""
    if plan is None:
        return np.full(4, -1.0)
    age = (stamp_ns - plan.stamp_ns) / NS_PER_S
    phase = plan.swing_phase + age * plan.swing_rate
    return np.where(plan.in_stance | (phase >= 1.0), -1.0, phase)
