"""What the operator's terminal shows: what was heard of the run, as rows of figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from layered_cbf_ros.interfaces import NS_PER_S, Array, PlannedMotion, VelocityCommand
from layered_cbf_ros.operation.terminal_pad import HeldKeys
from layered_cbf_ros.operation.virtual_pad import PadState

SITTING = -0.01
"""Planned height below which a robot sits, or is about to [m]."""


@dataclass(frozen=True, slots=True)
class Heard:
    """What the graph told last.

    Attributes:
        robots: Names of the team, in its order.
        stamp_ns: Time of the run [ns].
        heard_ns: Wall time at which the coordinator was heard last [ns], None if never.
        places: Centres of robots and tracked obstacles in the world plane [m], by name.
        speeds: Measured speed of each robot [m/s].
        plans: Safe motion of each robot.
        desired: Desired speed of each robot [m/s].
        held: Robots that can't obey.
        interventions: |u - u_desired| of each robot [m/s^2].
        barriers: psi0 of each pair `a~b` [m].
        commands: What each robot is asked, None or missing if it follows its goal.
        is_stopped: Whether the emergency stop is latched.
        told: The coordinator's own words on /diagnostics.
    """

    robots: tuple[str, ...] = ()
    stamp_ns: int = 0
    heard_ns: int | None = None
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)
    plans: Mapping[str, PlannedMotion] = field(default_factory=dict)
    desired: Mapping[str, float] = field(default_factory=dict)
    held: frozenset[str] = frozenset()
    interventions: Mapping[str, float] = field(default_factory=dict)
    barriers: Mapping[str, float] = field(default_factory=dict)
    commands: Mapping[str, VelocityCommand | None] = field(default_factory=dict)
    is_stopped: bool = False
    told: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RobotRow:
    """One robot on the screen; None and '' are not known.

    Attributes:
        name: Its name.
        measured, planned, desired: Speeds [m/s].
        neighbour: Nearest robot or obstacle.
        distance: From centre to centre [m].
        h: Smallest psi0 of its pairs [m].
        intervention: |u - u_desired| [m/s^2].
        state: 'steered', 'goal', 'held', 'sitting' or '' in words.
    """

    name: str
    measured: float | None = None
    planned: float | None = None
    desired: float | None = None
    neighbour: str = ''
    distance: float | None = None
    h: float | None = None
    intervention: float | None = None
    state: str = ''


@dataclass(frozen=True, slots=True)
class ScreenView:
    """All that the screen shows.

    Attributes:
        silence_s: Wall time since the coordinator was heard [s], None if it never was.
        domain: The ROS domain that is listened to.
        stamp_s: Time of the run [s].
        operator: Who steers, by frame_id; '' for nobody.
        refused: Why the coordinator refused something last, '' if it didn't.
        is_stopped: Whether the emergency stop is latched.
        robots: A row for each robot.
        keys: The keyboard: speed and turbo.
        pad: What is held on it.
        own_name: The keyboard's own frame_id.
        note: What the program itself has to say.
    """

    silence_s: float | None
    domain: str
    stamp_s: float = 0.0
    operator: str = ''
    refused: str = ''
    is_stopped: bool = False
    robots: tuple[RobotRow, ...] = ()
    keys: HeldKeys = field(default_factory=HeldKeys)
    pad: PadState = field(default_factory=PadState)
    own_name: str = ''
    note: str = ''


def with_desired(heard: Heard, names: Sequence[str], speeds: Array, held: Array) -> Heard:
    """Take the desired velocities `<r>/x`, `<r>/y` [m/s], and 1 where a robot can't obey."""
    parts: dict[str, list[float]] = {}
    unable = set()
    for name, value, cannot in zip(names, speeds, held, strict=True):
        robot = name.rpartition('/')[0]
        parts.setdefault(robot, []).append(float(value))
        if cannot:
            unable.add(robot)
    desired = {robot: math.hypot(*values) for robot, values in parts.items()}
    return replace(heard, desired=desired, held=frozenset(unable))


def with_tracks(heard: Heard, tracks: Mapping[str, tuple[float, float]]) -> Heard:
    """Take the places of all that is tracked [m]; what isn't any more is forgotten."""
    robots = {name: place for name, place in heard.places.items() if name in heard.robots}
    return replace(heard, places={**robots, **tracks})


def with_words(heard: Heard, told: Mapping[str, str]) -> Heard:
    """Take what the coordinator tells of itself once a second.

    The emergency stop is known from there only until the first commands: they are faster.
    """
    is_stopped = heard.is_stopped if heard.commands else told.get('e_stop') == 'latched'
    return replace(heard, told=told, is_stopped=is_stopped)


def row_of(heard: Heard, robot: str) -> RobotRow:
    """Return what is known of a robot."""
    plan = heard.plans.get(robot)
    neighbour, distance = _nearest(heard, robot)
    pairs = [h for label, h in heard.barriers.items() if robot in label.split('~')]
    return RobotRow(
        robot,
        heard.speeds.get(robot),
        None if plan is None else math.hypot(*plan.velocity),
        heard.desired.get(robot),
        neighbour,
        distance,
        min(pairs, default=None),
        heard.interventions.get(robot),
        _state(heard, robot, plan),
    )


def view_of(heard: Heard, shown: Sequence[str], domain: str, now_ns: int) -> ScreenView:
    """Return what there is to show of a run.

    Args:
        heard: What the graph told.
        shown: The robots to show.
        domain: The ROS domain that is listened to.
        now_ns: Wall time [ns].
    """
    silence = None if heard.heard_ns is None else (now_ns - heard.heard_ns) / NS_PER_S
    return ScreenView(
        silence,
        domain,
        heard.stamp_ns / NS_PER_S,
        heard.told.get('operator', ''),
        heard.told.get('last_rejected', ''),
        heard.is_stopped,
        tuple(row_of(heard, robot) for robot in shown),
    )


def _nearest(heard: Heard, robot: str) -> tuple[str, float | None]:
    """Return who is nearest to a robot, and how far its centre is [m]."""
    own = heard.places.get(robot)
    if own is None:
        return '', None
    others = [
        (math.dist(own, place), name) for name, place in heard.places.items() if name != robot
    ]
    distance, name = min(others, default=(None, ''))
    return name, distance


def _state(heard: Heard, robot: str, plan: PlannedMotion | None) -> str:
    if plan is not None and plan.height < SITTING:
        return 'sitting'
    if robot in heard.held:
        return 'held'
    if heard.commands.get(robot) is not None:
        return 'steered'
    return 'goal' if robot in heard.desired else ''
