"""The simulated plant: quadrupeds, moving cylinders and walls in PyBullet.

A world lives in its own PyBullet connection, steps by 1 ms and is told the
torques of each step. Two worlds built from the same scenario and given the same
torques go through the same states, bit for bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import GRAVITY, NS_PER_S, Array, RobotState
from layered_cbf_ros.plants.bullet_robot import TOE_FRICTION, BulletRobot
from layered_cbf_ros.plants.clearance import ClearanceMeter
from layered_cbf_ros.plants.clearance_report import ClearanceReport
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.scenario import Obstacle, Push, Scenario, Wall

STEP_NS = 1_000_000
DOWN = (0.0, 0.0, -GRAVITY)  # [m/s^2]
_WALL_HALF_SIZE = (200.0, 0.5, 1.0)  # along, across, height [m]


@dataclass(frozen=True, slots=True)
class ImuReading:
    """What the trunk's inertial measurement unit reads.

    Attributes:
        orientation: Of the base in the world, quaternion x, y, z, w, (4,).
        angular_velocity: In the base frame [rad/s], (3,).
        specific_force: Acceleration minus gravity of the base's origin, mean over
            the last step, base frame [m/s^2], (3,).
    """

    orientation: Array
    angular_velocity: Array
    specific_force: Array


class BulletWorld:
    """A scenario's robots, obstacles and walls on flat ground."""

    def __init__(
        self, scenario: Scenario, parameters: SimulatorParameters, starts: Sequence[Array]
    ) -> None:
        """Build the world at time 0.

        Args:
            scenario: What is in it and what disturbs it.
            parameters: Of the simulator.
            starts: Each robot's configuration, as in RobotState, (19,).
        """
        self._client = client = BulletClient(pybullet.DIRECT)
        client.setTimeStep(STEP_NS / NS_PER_S)
        client.setGravity(*DOWN)
        client.setPhysicsEngineParameter(deterministicOverlappingPairs=1)
        self._scenario, self._parameters = scenario, parameters
        fixtures = {'ground': _ground(client, scenario.world.friction)}
        fixtures |= {wall.name: _wall(client, wall) for wall in scenario.walls}
        fixtures |= {thing.name: _cylinder(client, thing) for thing in scenario.obstacles}
        self._cylinders = [fixtures[thing.name] for thing in scenario.obstacles]
        self._robots = [
            BulletRobot(client, start, robot.payload)
            for start, robot in zip(starts, scenario.robots, strict=True)
        ]
        self._pushes = _schedule(scenario)
        count = len(self._robots)
        ticks = round(scenario.world.torque_delay * NS_PER_S / STEP_NS)
        self._pending = deque(np.zeros((count, 12)) for _ in range(ticks))
        self._damped = np.zeros(count, dtype=bool)
        self._toes = {
            (robot.body, toe): (i, foot)
            for i, robot in enumerate(self._robots)
            for foot, toe in enumerate(robot.toes)
        }
        self._meter = ClearanceMeter(
            client, scenario, self._robots, fixtures, parameters.exact_within
        )
        self._ground = fixtures['ground']
        self._peak_forces = np.zeros(len(self._meter.labels))
        self._stamp_ns = 0
        self._move_obstacles()

    @property
    def stamp_ns(self) -> int:
        """Time of the present state [ns]."""
        return self._stamp_ns

    def states(self) -> tuple[RobotState, ...]:
        """Return the present state of each robot."""
        return tuple(robot.state for robot in self._robots)

    def damp(self, robot: int) -> None:
        """Let a robot's joints be damped in the next step, whatever it is told."""
        self._damped[robot] = True

    def step(self, torques: Array) -> None:
        """Go on by one step.

        Args:
            torques: Joint torques of each robot [Nm], (N, 12); beyond the limit
                they are cut, and they act after the scenario's delay.

        Raises:
            MessageError: If a torque isn't finite.
        """
        acting = self._acting(torques)
        for robot, torque in zip(self._robots, acting, strict=True):
            robot.apply(torque)
        for push, index, begin, end in self._pushes:
            if begin <= self._stamp_ns < end:
                self._robots[index].push(push.force)
        self._client.stepSimulation()
        self._stamp_ns += STEP_NS
        self._move_obstacles()
        foot_forces = self._read_contacts()
        for i, robot in enumerate(self._robots):
            robot.read(self._stamp_ns, acting[i], foot_forces[i])

    def obstacle_positions(self) -> Array:
        """Return the true centre of each obstacle [m], (M, 2)."""
        t = self._stamp_ns / NS_PER_S
        centres = [thing.motion.at(t)[0] for thing in self._scenario.obstacles]
        return np.array(centres).reshape(-1, 2)

    def imu(self, robot: int) -> ImuReading:
        """Return what a robot's inertial measurement unit reads."""
        it = self._robots[robot]
        return ImuReading(
            it.state.configuration[3:7], it.state.velocity[3:6], it.specific_force(DOWN)
        )

    def clearances(self) -> ClearanceReport:
        """Return how close all pairs are, and the peak forces since the last call."""
        peaks, self._peak_forces = self._peak_forces, np.zeros_like(self._peak_forces)
        distances = self._meter.distances(self._stamp_ns / NS_PER_S)
        return ClearanceReport(self._stamp_ns, self._meter.labels, distances, peaks)

    def close(self) -> None:
        """Let go of the physics engine."""
        self._client.disconnect()

    def _acting(self, torques: Array) -> Array:
        """Return the torques that act in this step: cut, delayed, or damping, (N, 12)."""
        if not np.isfinite(torques).all():
            robot = self._scenario.robots[int(np.argwhere(~np.isfinite(torques))[0, 0])].name
            raise MessageError(f'{robot}: a joint torque is not finite; send numbers')
        limit = self._parameters.torque_limit
        self._pending.append(np.clip(torques, -limit, limit))
        acting = self._pending.popleft()
        if self._damped.any():
            for i in np.flatnonzero(self._damped):
                speed = self._robots[i].state.velocity[6:]
                acting[i] = np.clip(-self._parameters.damping * speed, -limit, limit)
            self._damped[:] = False
        return acting

    def _move_obstacles(self) -> None:
        """Put each cylinder where its pattern has it, and give it its velocity."""
        t = self._stamp_ns / NS_PER_S
        for body, thing in zip(self._cylinders, self._scenario.obstacles, strict=True):
            (x, y), (vx, vy) = (vector.tolist() for vector in thing.motion.at(t))
            self._client.resetBasePositionAndOrientation(
                body, (x, y, 0.5 * thing.height), (0.0, 0.0, 0.0, 1.0)
            )
            self._client.resetBaseVelocity(body, (vx, vy, 0.0), (0.0, 0.0, 0.0))

    def _read_contacts(self) -> Array:
        """Return the normal force on each foot [N], (N, 4); note every other contact."""
        feet = np.zeros((len(self._robots), 4))
        pairs: dict[int, float] = {}
        for contact in self._client.getContactPoints():
            a, b, link_a, link_b = contact[1:5]
            if a == self._ground:  # the ground is loaded first, and Bullet may swap
                a, b, link_a = b, a, link_b
            force = contact[9]
            if b == self._ground and (a, link_a) in self._toes:
                feet[self._toes[a, link_a]] += force
                continue
            k = self._meter.index.get((a, b), self._meter.index.get((b, a)))
            if k is not None:
                pairs[k] = pairs.get(k, 0.0) + force
        for k, force in pairs.items():
            self._peak_forces[k] = max(self._peak_forces[k], force)
        return feet


def _ground(client: BulletClient, friction: float) -> int:
    """Add flat ground whose friction with a toe is as told."""
    shape = client.createCollisionShape(pybullet.GEOM_PLANE)
    body: int = client.createMultiBody(0.0, shape)
    client.changeDynamics(body, -1, lateralFriction=friction / TOE_FRICTION)
    return body


def _wall(client: BulletClient, wall: Wall) -> int:
    """Add a long box whose face is the wall's surface."""
    _, across, up = _WALL_HALF_SIZE
    shape = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=_WALL_HALF_SIZE)
    nx, ny = wall.normal
    centre = (wall.point[0] - across * nx, wall.point[1] - across * ny, up)
    turned = client.getQuaternionFromEuler((0.0, 0.0, float(np.arctan2(-nx, ny))))
    body: int = client.createMultiBody(0.0, shape, -1, centre, turned)
    return body


def _cylinder(client: BulletClient, obstacle: Obstacle) -> int:
    """Add a cylinder that nothing moves but its pattern."""
    shape = client.createCollisionShape(
        pybullet.GEOM_CYLINDER, radius=obstacle.radius, height=obstacle.height
    )
    body: int = client.createMultiBody(0.0, shape)
    return body


def _schedule(scenario: Scenario) -> list[tuple[Push, int, int, int]]:
    """Return each push with its robot's index, begin and end [ns]."""
    names = [robot.name for robot in scenario.robots]
    return [
        (
            push,
            names.index(push.robot),
            round(push.at * NS_PER_S),
            round((push.at + push.duration) * NS_PER_S),
        )
        for push in scenario.world.pushes
    ]
