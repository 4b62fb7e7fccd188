"""The operator's desk: who steers which robots, how fast, and whether all are stopped.

Every Joy publisher is a source, named by its frame_id. Who holds a dead-man button owns
the control until he lets go or is silent. Anybody may stop; only a reset on purpose ends it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.operation.joystick import Choice, Hands

RESET_HOLD_NS = NS_PER_S
"""How long the reset button has to be held [ns]."""


@dataclass(frozen=True, slots=True)
class Now:
    """One moment on the two clocks: the run's, and the wall's monotonic one [ns]."""

    run_ns: int
    wall_ns: int

    def of(self, scripted: bool) -> int:
        """Return the clock that counts for a source: a script lives in the run's time."""
        return self.run_ns if scripted else self.wall_ns


@dataclass(frozen=True, slots=True)
class Source:
    """One joystick.

    Attributes:
        hands: What it said last.
        heard_ns: When, on its clock [ns].
        reset_since_ns: Since when the reset button is held [ns], None if it isn't.
        scripted: Whether it belongs to the simulated world.
    """

    hands: Hands
    heard_ns: int
    reset_since_ns: int | None = None
    scripted: bool = False


@dataclass(frozen=True, slots=True)
class Asked:
    """The last velocity that a planner asked for: x, y [m/s], yaw rate [rad/s], and when [ns]."""

    x: float
    y: float
    yaw_rate: float
    heard_ns: int


@dataclass(frozen=True, slots=True)
class Desk:
    """All that is known of operators and planners.

    Attributes:
        sources: Joysticks that were heard, by frame_id.
        owner: Who steers, '' for nobody.
        steered: Indices of the robots that the operator has in hand.
        formation: Whether these all get the same velocity.
        planned: What planners ask for, by the index of the robot.
        stopped: The emergency stop, latched.
        clamped: How many velocities were beyond the limits.
    """

    sources: Mapping[str, Source] = field(default_factory=dict)
    owner: str = ''
    steered: tuple[int, ...] = ()
    formation: bool = False
    planned: Mapping[int, Asked] = field(default_factory=dict)
    stopped: bool = False
    clamped: int = 0

    @property
    def is_idle(self) -> bool:
        """Tell whether nobody ever asked for anything."""
        return not (self.sources or self.planned or self.stopped)


def heard(
    desk: Desk,
    name: str,
    hands: Hands,
    now: Now,
    robots: int,
    timeout_ns: int,
    scripted: bool = False,
) -> tuple[Desk, str]:
    """Take what a joystick says; an emergency stop counts whoever steers.

    Args:
        desk: As it is.
        name: The joystick's frame_id.
        hands: What it says.
        now: When it came.
        robots: Size of the team.
        timeout_ns: Silence after which a joystick counts as released [ns].
        scripted: Whether it belongs to the simulated world.

    Returns:
        The desk, and why the joystick is refused, '' if it isn't.
    """
    before = desk.sources.get(name)
    time_ns = now.of(scripted)
    if before is not None and time_ns - before.heard_ns > timeout_ns:
        before = None
    since_ns = None
    if hands.reset:
        since_ns = time_ns if before is None else before.reset_since_ns
        since_ns = time_ns if since_ns is None else since_ns
    source = Source(hands, time_ns, since_ns, scripted)
    desk = replace(released(desk, now, timeout_ns), sources={**desk.sources, name: source})
    if hands.e_stop:
        return stopped(desk), ''
    if since_ns is not None and time_ns - since_ns >= RESET_HOLD_NS:
        desk = replace(desk, stopped=desk.stopped and _somebody_presses(desk, now, timeout_ns))
    if desk.owner not in ('', name):
        wants = hands.enable or hands.choice is not None
        return desk, f"joy from '{name}' is refused: '{desk.owner}' steers" if wants else ''
    if hands.choice is not None and (before is None or before.hands.choice != hands.choice):
        desk = _chosen(desk, hands.choice, robots)
    if hands.enable and not desk.stopped and not desk.steered:
        desk = replace(desk, steered=(0,), formation=False)
    return replace(desk, owner=name if hands.enable and not desk.stopped else ''), ''


def asked(desk: Desk, robot: int, wish: Asked, limits: tuple[float, float]) -> Desk:
    """Take the velocity that a planner asks of a robot, within the limits.

    Args:
        desk: As it is.
        robot: Index of the robot.
        wish: What it asks for; finite.
        limits: Largest speed [m/s] and yaw rate [rad/s].
    """
    speed, (fastest, turning) = (wish.x**2 + wish.y**2) ** 0.5, limits
    scale = fastest / speed if speed > fastest else 1.0
    yaw_rate = min(max(wish.yaw_rate, -turning), turning)
    kept = Asked(scale * wish.x, scale * wish.y, yaw_rate, wish.heard_ns)
    beyond = scale != 1.0 or yaw_rate != wish.yaw_rate
    return replace(desk, planned={**desk.planned, robot: kept}, clamped=desk.clamped + beyond)


def stopped(desk: Desk) -> Desk:
    """Return the desk with the emergency stop latched."""
    return replace(desk, stopped=True, owner='')


def reset(desk: Desk) -> Desk:
    """Return the desk with the emergency stop ended; nobody steers until he asks anew."""
    return replace(desk, stopped=False, owner='')


def released(desk: Desk, now: Now, timeout_ns: int) -> Desk:
    """Take the control from an owner who has been silent for too long."""
    if not desk.owner:
        return desk
    source = desk.sources[desk.owner]
    silent = now.of(source.scripted) - source.heard_ns > timeout_ns
    return replace(desk, owner='') if silent else desk


def _chosen(desk: Desk, choice: Choice | int, robots: int) -> Desk:
    """Return the desk with other robots in the operator's hand."""
    if choice is Choice.NOBODY:
        return replace(desk, steered=(), formation=False)
    if choice is Choice.ALL or choice is Choice.FORMATION:
        return replace(desk, steered=tuple(range(robots)), formation=choice is Choice.FORMATION)
    if isinstance(choice, Choice):  # the next one
        choice = (desk.steered[0] + 1) % robots if len(desk.steered) == 1 else 0
    return replace(desk, steered=(choice,), formation=False)


def _somebody_presses(desk: Desk, now: Now, timeout_ns: int) -> bool:
    """Tell whether an emergency stop button is held right now."""
    return any(
        source.hands.e_stop and now.of(source.scripted) - source.heard_ns <= timeout_ns
        for source in desk.sources.values()
    )
