"""What an A1 must never do: each rule looks at one state and names what is wrong.

Rules that a spike must not trip count as the vendor's power protection does: up with each
state over the limit, down with each one under it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.interfaces import JOINT_NAMES, Array
from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.a1.frames import OVERHEATED, SERVO, LowState
from layered_cbf_ros.plants.a1.poses import HIGHEST, LOWEST

POWER_UNIT = 100.0
"""Of the power factor [W]."""
UNIT_TOLERANCE = 0.01
"""How far the square of a quaternion's length may be from 1."""
STOPS = (frozenset({'R2'}), frozenset({'L2', 'B'}))
"""Buttons of the robot's own remote control that mean: damp."""


@dataclass(frozen=True, slots=True)
class Overloads:
    """How often the robot was over each limit lately."""

    torque: int = 0
    speed: int = 0
    power: int = 0


class Protection:
    """The rules, with one robot's limits."""

    def __init__(self, parameters: DriverParameters) -> None:
        self._parameters = parameters
        self._least_upright = math.cos(math.radians(parameters.tilt))

    def check(
        self,
        overloads: Overloads,
        state: LowState,
        buttons: frozenset[str],
        upright: bool,
        obeying: bool,
    ) -> tuple[Overloads, str]:
        """Judge a state that was not judged before.

        Args:
            overloads: From the state before.
            state: What the robot tells.
            buttons: What is pressed on its remote control.
            upright: Whether it stands on its legs: then its joints are far from their stops.
            obeying: Whether its motors have been obeying up to now.

        Returns:
            The memory for the next state, and what is wrong, '' if nothing is.
        """
        p = self._parameters
        torques, speeds = np.abs(state.torque), np.abs(state.velocity)
        power = float(torques @ speeds)
        counted = Overloads(
            _count(overloads.torque, torques.max() > p.torque),
            _count(overloads.speed, speeds.max() > p.speed),
            _count(overloads.power, power > POWER_UNIT * p.power_factor),
        )
        fault = (
            remote_fault(buttons)
            or (mode_fault(state) if obeying else '')
            or self._tilt_fault(state.orientation)
            or self._limit_fault(state.position, upright)
            or self._temperature_fault(state)
            or self._overload_fault(counted, torques, speeds, power)
        )
        return counted, fault

    def _tilt_fault(self, orientation: Array) -> str:
        """Compare the angle between the trunk's and the world's vertical with its limit."""
        x, y, _, _ = orientation
        squared = float(orientation @ orientation)
        if not abs(squared - 1.0) <= UNIT_TOLERANCE:
            return f'IMU orientation has length {math.sqrt(squared):.3f}, not 1'
        upright = 1.0 - 2.0 * (x * x + y * y)
        if upright >= self._least_upright:
            return ''
        tilt = math.degrees(math.acos(max(-1.0, upright)))
        return f'tilt of {tilt:.0f} deg, limit {self._parameters.tilt:.0f} deg'

    def _limit_fault(self, position: Array, upright: bool) -> str:
        """Keep joints off their limits; those of a lying robot may rest against their stops."""
        p = self._parameters
        margin = p.joint_margin if upright else -p.stop_margin
        room = np.minimum(position - LOWEST, HIGHEST - position)
        joint = int(room.argmin())
        if room[joint] >= margin:
            return ''
        return (
            f'{JOINT_NAMES[joint]} at {position[joint]:.3f} rad, '
            f'limits {LOWEST[joint]:.3f} and {HIGHEST[joint]:.3f} rad'
        )

    def _temperature_fault(self, state: LowState) -> str:
        hottest = int(state.temperature.argmax())
        if state.temperature[hottest] <= self._parameters.temperature:
            return ''
        return (
            f'{JOINT_NAMES[hottest]} has {state.temperature[hottest]} degC, '
            f'limit {self._parameters.temperature} degC'
        )

    def _overload_fault(
        self, counted: Overloads, torques: Array, speeds: Array, power: float
    ) -> str:
        p = self._parameters
        if counted.torque > p.forgiven_states:
            name, value = _largest(torques)
            return f'{name} at {value:.1f} Nm, limit {p.torque:.1f} Nm'
        if counted.speed > p.forgiven_states:
            name, value = _largest(speeds)
            return f'{name} at {value:.1f} rad/s, limit {p.speed:.1f} rad/s'
        if counted.power > p.forgiven_states:
            return f'power of {power:.0f} W, limit {POWER_UNIT * p.power_factor:.0f} W'
        return ''


def remote_fault(buttons: frozenset[str]) -> str:
    """Tell what is pressed on the remote control that means: damp."""
    for stop in STOPS:
        if stop <= buttons:
            return f'{" + ".join(sorted(stop, reverse=True))} pressed on the remote control'
    return ''


def mode_fault(state: LowState) -> str:
    """Name the first motor that doesn't obey."""
    if (state.mode == SERVO).all():
        return ''
    joint = int((state.mode != SERVO).argmax())
    why = ', overheated' if state.mode[joint] == OVERHEATED else ''
    return f'{JOINT_NAMES[joint]} is in mode {state.mode[joint]}{why}; {SERVO} obeys'


def _count(before: int, over: bool) -> int:
    return before + 1 if over else max(0, before - 1)


def _largest(values: Array) -> tuple[str, float]:
    joint = int(values.argmax())
    return JOINT_NAMES[joint], float(values[joint])
