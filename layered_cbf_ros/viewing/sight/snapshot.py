"""All that is to be seen of a run at one instant; whoever draws it asks for nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field

from layered_cbf_ros.interfaces import Array, PlannedMotion
from layered_cbf_ros.scenario import Wall


@dataclass(frozen=True, slots=True)
class RobotSight:
    """One robot.

    Attributes:
        name: Its name.
        configuration: As in RobotState, (19,); of a base without legs the joints are 0.
        velocity: CoM velocity in the world plane [m/s], (2,).
        foot_positions: Toe centres in the world [m], (4, 3).
        foot_forces: Planned ground reaction forces in the world [N], (4, 3).
        has_legs: False for a base with its own locomotion: a disc with a heading.
        radius: Of the disc that the coordinator takes it for [m].
        plan: Its safe motion, None before the first.
        target: Its desired velocity in the world [m/s], (2,).
        reach: Centre [m] and radius [m] of the ball around its reachable set, (3,).
        intervention: |u - u_desired| [m/s^2].
        is_held: Whether it can't obey: frozen, standing or sitting.
        is_steered: Whether an operator or planner commands it.
    """

    name: str
    configuration: Array
    velocity: Array
    foot_positions: Array
    foot_forces: Array
    has_legs: bool
    radius: float
    plan: PlannedMotion | None
    target: Array
    reach: Array
    intervention: float
    is_held: bool
    is_steered: bool


@dataclass(frozen=True, slots=True)
class ObstacleSight:
    """One obstacle.

    Attributes:
        name: Its name.
        position: Centre in the world plane [m], (2,).
        velocity: Its velocity [m/s], (2,).
        radius, height: Its size [m].
        is_tracked: Whether this is an estimate, else the truth.
    """

    name: str
    position: Array
    velocity: Array
    radius: float
    height: float
    is_tracked: bool


@dataclass(frozen=True, slots=True)
class BallSight:
    """The region of potential collision of one pair.

    Attributes:
        label: The pair, `a~b`.
        centre: q in the world plane [m], (2,).
        radius: r [m].
        h: psi0 of the pair [m]: its colour.
    """

    label: str
    centre: Array
    radius: float
    h: float


@dataclass(frozen=True, slots=True)
class BarrierSight:
    """The barrier functions of one pair: psi0 [m], psi1 [m/s], psi2 [m/s^2], slack [m/s^2]."""

    label: str
    psi0: float
    psi1: float
    psi2: float
    slack: float


@dataclass(frozen=True, slots=True)
class NodeSight:
    """What a node tells of itself.

    Attributes:
        name: Full name of the node.
        level: 'OK', 'WARN', 'ERROR' or 'STALE'.
        message: What a person should know.
        values: Its figures, as on /diagnostics.
    """

    name: str
    level: str
    message: str
    values: dict[str, str]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One instant of a run.

    Attributes:
        stamp_ns: Its time [ns].
        robots, obstacles, walls, balls, barriers: Who is there, and what keeps them apart.
        distances: Surface distance of each pair [m], as far as it is known.
        nodes: What nodes told last; empty from a bag without /diagnostics.
        is_stopped: Whether the emergency stop is latched.
        is_paused: Whether the simulator is paused.
    """

    stamp_ns: int
    robots: tuple[RobotSight, ...] = ()
    obstacles: tuple[ObstacleSight, ...] = ()
    walls: tuple[Wall, ...] = ()
    balls: tuple[BallSight, ...] = ()
    barriers: tuple[BarrierSight, ...] = ()
    distances: dict[str, float] = field(default_factory=dict)
    nodes: tuple[NodeSight, ...] = ()
    is_stopped: bool = False
    is_paused: bool = False
