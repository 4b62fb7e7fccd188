"""What the driver of an A1 hears, remembers and answers."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.plants.a1.frames import LowState
from layered_cbf_ros.plants.a1.poses import PosePath
from layered_cbf_ros.plants.a1.protection import Overloads


class Phase(enum.Enum):
    """What the driver does; the words are those of `driver_state`."""

    DISARMED = 'disarmed'
    """It sends nothing."""
    ENGAGING = 'engaging'
    """It damps, until the robot answers and its motors obey."""
    STANDING_UP = 'standing_up'
    STANDING = 'standing'
    """It holds the standing pose, until a controller carries the robot."""
    RUNNING = 'running'
    """The controller's torques act."""
    SITTING_DOWN = 'sitting_down'
    DAMPED = 'damped'
    """It damps for a while, then switches the motors off."""
    OFF = 'off'
    """It tells the motors to be off, a few times; then it is disarmed."""
    FAULT = 'fault'
    """It damps, until a person resets it."""


SEIZED = frozenset(Phase) - {Phase.DISARMED}
UPRIGHT = frozenset({Phase.STANDING, Phase.RUNNING})
ACTIVE = UPRIGHT | {Phase.STANDING_UP, Phase.SITTING_DOWN}
"""Phases in which joints are driven: silence is a fault in them."""


class Order(enum.Enum):
    """What a person, or the end of the process, asks of the driver."""

    ARM = 'arm'
    SIT_DOWN = 'sit_down'
    RESET = 'reset'
    END = 'end'


@dataclass(frozen=True, slots=True)
class JointCommand:
    """What a controller asks of the joints.

    Attributes:
        stamp_ns: Stamp of the state it was computed from [ns].
        position, velocity, torque: [rad], [rad/s], [Nm], (12,) each.
    """

    stamp_ns: int
    position: Array
    velocity: Array
    torque: Array


@dataclass(frozen=True, slots=True)
class Heard:
    """What is known at one cycle.

    Attributes:
        now_ns: Time of the cycle [ns].
        state: What the robot told last, None before it did.
        state_ns: When it came [ns].
        is_new: Whether it came since the last cycle.
        buttons: What is pressed on its remote control.
        command: The controller's last, None before the first.
        bad_command: What was wrong with a command that came since the last cycle, or ''.
        emergency_stop: Whether one was asked for since the last cycle.
    """

    now_ns: int
    state: LowState | None = None
    state_ns: int = 0
    is_new: bool = False
    buttons: frozenset[str] = frozenset()
    command: JointCommand | None = None
    bad_command: str = ''
    emergency_stop: bool = False


@dataclass(frozen=True, slots=True)
class Memory:
    """What one cycle hands to the next.

    Attributes:
        phase: What the driver does.
        since_ns: When that began [ns].
        fault: What went wrong; latched, until a reset.
        complaint: Why the robot was given up when it was armed last.
        valid: How many good states came in a row.
        overloads: Of the protection.
        path: Poses it moves through.
        torque: Torques that fade while it sits down [Nm], (12,).
    """

    phase: Phase = Phase.DISARMED
    since_ns: int = 0
    fault: str = ''
    complaint: str = ''
    valid: int = 0
    overloads: Overloads = field(default_factory=Overloads)
    path: PosePath = field(default_factory=lambda: PosePath((), ()))
    torque: Array = field(default_factory=lambda: np.zeros(12))

    @property
    def trouble(self) -> str:
        """Return what a person has to know, '' if all is well."""
        return self.fault or self.complaint


@dataclass(frozen=True, slots=True)
class Answer:
    """What a person is answered."""

    success: bool
    message: str
