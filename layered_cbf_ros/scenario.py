"""What a scenario file says: the world, the robots, what they want, and the seed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from layered_cbf_ros.patterns import Pattern
from layered_cbf_ros.scenario_emulation import Emulation
from layered_cbf_ros.scenario_operator import PadStep

BULLET, BASES, A1, EMULATED_A1 = 'bullet', 'bases', 'a1', 'emulated_a1'
HARDWARE = (A1, EMULATED_A1)
"""Plants at the other end of a wire, each robot with a driver."""
TRUTH, ESTIMATOR = 'truth', 'estimator'
LEGGED, OMNI, UNICYCLE = 'legged', 'omni', 'unicycle'


@dataclass(frozen=True)
class VelocityStep:
    """Desired velocity from a time on: x, y [m/s] in the script's frame, yaw_rate [rad/s]."""

    at: float
    x: float = 0.0
    y: float = 0.0
    yaw_rate: float = 0.0


@dataclass(frozen=True)
class Desired:
    """What a robot would do if it were alone: exactly one of these, or none to stand.

    Attributes:
        goal: A point to walk to [m].
        pattern: A pattern to follow for ever.
        velocity: A velocity script, sorted by time; frame is the robot's heading
            frame when `frame` is 'body', else the world.
        frame: 'world' or 'body', for the velocity script.
    """

    goal: tuple[float, float] | None = None
    pattern: Pattern | None = None
    velocity: tuple[VelocityStep, ...] = ()
    frame: str = 'body'


@dataclass(frozen=True)
class Robot:
    """One agent.

    Attributes:
        name: Its namespace.
        position: Start of its CoM in the plane [m].
        yaw: Start heading [rad].
        gait: 'trot' or 'stand'.
        desired: What it wants.
        payload: Extra mass fixed to the trunk, may be negative [kg].
        kind: 'legged': an A1 with the layers below; 'omni' or 'unicycle': a base with its
            own locomotion, which moves in every direction, or only forward and back.
        radius: Of the disc that a base is kept apart by [m], None: the coordinator's.
        address: Where a real A1 listens, as `192.168.123.10:8007`; '': there.
    """

    name: str
    position: tuple[float, float]
    yaw: float = 0.0
    gait: str = 'trot'
    desired: Desired = field(default_factory=Desired)
    payload: float = 0.0
    kind: str = LEGGED
    radius: float | None = None
    address: str = ''

    def disc(self, agent_radius: float) -> float:
        """Return the radius of its disc, given that of robots without their own [m]."""
        return agent_radius if self.radius is None else self.radius


@dataclass(frozen=True)
class Obstacle:
    """A kinematic cylinder that follows a pattern.

    Attributes:
        name: Its name.
        radius, height: Its size [m].
        motion: Its pattern.
    """

    name: str
    radius: float
    height: float
    motion: Pattern


@dataclass(frozen=True)
class Wall:
    """A half-plane: allowed is normal . (p - point) >= 0.

    Attributes:
        name: Its name.
        point: A point of its surface [m].
        normal: Unit normal, towards the allowed side.
    """

    name: str
    point: tuple[float, float]
    normal: tuple[float, float]


@dataclass(frozen=True)
class Push:
    """A force on a robot's trunk: world frame [N], from `at` for `duration` [s]."""

    robot: str
    at: float
    duration: float
    force: tuple[float, float, float]


@dataclass(frozen=True)
class Detections:
    """How obstacles are seen.

    Attributes:
        noise: Standard deviation of each coordinate [m].
        delay: Age of a detection when it is published [s].
        dropout: Probability that one detection is missing, in [0, 1].
    """

    noise: float = 0.0
    delay: float = 0.0
    dropout: float = 0.0


@dataclass(frozen=True)
class World:
    """The ground and what disturbs the robots.

    Attributes:
        friction: Coefficient between toes and ground.
        torque_delay: Delay between a torque command and the joint [s].
        pushes: Injected pushes.
        detections: How obstacles are seen.
    """

    friction: float = 0.8
    torque_delay: float = 0.0
    pushes: tuple[Push, ...] = ()
    detections: Detections = field(default_factory=Detections)


@dataclass(frozen=True)
class Rates:
    """How often the graph computes, counted in the plant's time [Hz].

    Attributes:
        state: States, joint commands and the coordinator's ticks.
        plan: Safe trajectories and ground forces.
        detections: Obstacle detections and tracks.
    """

    state: int = 1000
    plan: int = 500
    detections: int = 100


@dataclass(frozen=True)
class Scenario:
    """One run, whole.

    Attributes:
        name: Name of the file.
        description: One sentence for a person.
        seed: Seed of everything random.
        duration: Longest simulated time [s].
        time: 'lockstep' or 'real_time'.
        plant: 'bullet': A1s and their layers; 'bases': bases with their own locomotion;
            'a1': real A1s, each with a driver; 'emulated_a1': the same drivers, and what
            answers them in place of the robots.
        states: What feeds the layers: 'truth', what is in the simulator, or 'estimator',
            what the robot's sensors tell of it.
        pace: How much of the run's time passes in a second, of emulated robots.
        goal_tolerance: Distance at which a goal counts as reached [m].
        robots, obstacles, walls: Who is there.
        world: The ground and the disturbances.
        rates: How often the graph computes.
        parameters: Node parameters that differ from params/*.yaml, by node.
        operator: What a simulated operator holds on a virtual pad.
        emulation: How emulated robots differ from perfect ones.
    """

    name: str
    description: str
    seed: int
    duration: float
    time: str
    plant: str
    goal_tolerance: float
    robots: tuple[Robot, ...]
    obstacles: tuple[Obstacle, ...] = ()
    walls: tuple[Wall, ...] = ()
    world: World = field(default_factory=World)
    rates: Rates = field(default_factory=Rates)
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    operator: tuple[PadStep, ...] = ()
    states: str = TRUTH
    pace: float = 1.0
    emulation: Emulation = field(default_factory=Emulation)
