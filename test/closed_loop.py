"""One robot's two lower layers and the simulated plant in one process, without ROS.

The layers are coupled with the latencies of the node graph: a torque acts one tick
after the state it was computed from, planned forces are 2 to 3 ms old, and the
planned motion 1 to 2 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from layered_cbf_ros.ground_forces.ground_force_mpc import GroundForceMpc, MpcStatus
from layered_cbf_ros.ground_forces.mpc_inputs import MpcInputs
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.ground_forces.single_rigid_body import RigidBody
from layered_cbf_ros.interfaces import (
    NS_PER_S,
    Array,
    GroundForcePlan,
    PlannedMotion,
    RobotState,
)
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Robot, Scenario, World
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.virtual_constraints import BodyReference, level_body
from layered_cbf_ros.whole_body.whole_body_controller import WholeBodyController

TICK_NS = 1_000_000
PLAN_TICKS = 2

Motion = Callable[[int], PlannedMotion]
Height = Callable[[int], tuple[float, float, float]]
Sensed = Callable[[BulletWorld, GroundForcePlan | None], RobotState]


@dataclass
class Recording:
    """What a run was like, a row a tick.

    Attributes:
        time: [s], (n,).
        com, com_velocity: World [m], [m/s], (n, 3).
        reference: Desired CoM [m], (n, 3).
        tilt: Roll and pitch [deg], (n, 2).
        yaw, yaw_reference: [rad], (n,), not wrapped.
        torques: As computed [Nm], (n, 12).
        forces: As planned by the whole-body controller, world [N], (n, 4, 3).
        foot_forces: Measured normal forces [N], (n, 4).
        failures: Ticks of either layer that didn't solve.
    """

    time: Array
    com: Array
    com_velocity: Array
    reference: Array
    tilt: Array
    yaw: Array
    yaw_reference: Array
    torques: Array
    forces: Array
    foot_forces: Array
    failures: int

    def after(self, start: float) -> Recording:
        """Return the part from a time on [s]."""
        keep = self.time >= start
        parts = {
            name: value[keep] if isinstance(value, np.ndarray) else value
            for name, value in vars(self).items()
        }
        return Recording(**parts)

    @property
    def error(self) -> Array:
        """CoM minus its reference [m], (n, 3)."""
        return self.com - self.reference


@dataclass
class ClosedLoop:
    """What to couple; `run` builds it anew each time.

    Attributes:
        motion: Planned motion by stamp.
        world: Ground and disturbances; pushes are for robot 'a1'.
        payload: Extra trunk mass that the controllers don't know [kg].
        mpc, wbc: Parameters of the layers.
        height: CoM height [m], its rate and acceleration by stamp; constant by default.
        mpc_alive: Tells by stamp whether the MPC answers.
        sensed: What the layers are told of the plant, given the plan in force; the truth
            by default.
    """

    motion: Motion
    world: World = field(default_factory=World)
    payload: float = 0.0
    mpc: GroundForceParameters = field(default_factory=GroundForceParameters)
    wbc: WholeBodyParameters = field(default_factory=WholeBodyParameters)
    height: Height | None = None
    mpc_alive: Callable[[int], bool] = lambda _: True
    sensed: Sensed = lambda plant, _: plant.states()[0]

    def run(self, duration: float) -> Recording:
        """Simulate from a nominal stance on the motion's first point [s]."""
        first = self.motion(0)
        nominal = RobotModel(self.wbc.com_height)
        start = nominal.nominal_configuration(first.position, first.yaw, self.wbc.com_height)
        robot = Robot('a1', tuple(first.position), first.yaw, payload=self.payload)
        scenario = Scenario(
            'closed_loop', '', 0, duration, 'lockstep', 'bullet', 0.1, (robot,), world=self.world
        )
        plant = BulletWorld(scenario, SimulatorParameters(), [start])
        try:
            return self._simulate(plant, round(duration * NS_PER_S / TICK_NS))
        finally:
            plant.close()

    def _simulate(self, plant: BulletWorld, ticks: int) -> Recording:
        planner = Planner(self.mpc, self.wbc.com_height)
        model = RobotModel(self.wbc.com_height)
        controller = WholeBodyController(self.wbc, model)
        state = controller.start(0)
        plans: list[GroundForcePlan] = []
        torques, failures = np.zeros(12), 0
        rows = []
        for tick in range(ticks):
            stamp = tick * TICK_NS
            plan = self._usable(plans, stamp)
            robot = self.sensed(plant, plan)
            motion = self._motion_known_at(stamp)
            body = self._body(motion, stamp)
            result = controller.track(state, robot, body, plan)
            state = result.state
            rows.append(_row(stamp, model, robot, body, motion, result.torques, result.forces))
            if tick % PLAN_TICKS == 0 and self.mpc_alive(stamp):
                plans.append(planner.step(robot, motion, body.com[2]))
            plant.step(torques[None])
            torques = result.torques
            failures += not result.solved
        columns = [np.array(column) for column in zip(*rows, strict=True)]
        columns[5:7] = np.unwrap(columns[5]), np.unwrap(columns[6])
        return Recording(*columns, failures=failures + planner.failures)

    def _body(self, motion: PlannedMotion, stamp: int) -> BodyReference:
        body = level_body(motion, self.wbc.com_height)
        if self.height is not None:
            body.com[2], body.com_velocity[2], body.com_acceleration[2] = self.height(stamp)
        return body

    def _motion_known_at(self, stamp: int) -> PlannedMotion:
        """Return the coordinator's latest point, 1 or 2 ms old, at a stamp."""
        known = max(0, (stamp // TICK_NS - 1) // PLAN_TICKS * PLAN_TICKS * TICK_NS)
        return self.motion(known).at(stamp)

    def _usable(self, plans: list[GroundForcePlan], stamp: int) -> GroundForcePlan | None:
        """Return the newest plan that is 2 ms old or more, unless it is stale."""
        old_enough = [plan for plan in plans[-2:] if plan.stamp_ns <= stamp - 2 * TICK_NS]
        fresh = [plan for plan in old_enough if stamp - plan.stamp_ns <= 20 * TICK_NS]
        return fresh[-1] if fresh else None


class Planner:
    """The ground-force MPC with its own model, as in its node."""

    def __init__(self, parameters: GroundForceParameters, com_height: float) -> None:
        self._model = RobotModel(com_height)
        body = RigidBody(self._model.mass, self._model.inertia, self._model.hip_offsets)
        self._mpc = GroundForceMpc(parameters, body)
        self._state = self._mpc.start(0)
        self.failures = 0

    def step(self, robot: RobotState, motion: PlannedMotion, height: float) -> GroundForcePlan:
        model = self._model
        model.update_kinematics(robot.configuration, robot.velocity)
        inputs = MpcInputs(
            robot.stamp_ns,
            model.com.copy(),
            model.com_velocity.copy(),
            model.rotation.copy(),
            robot.velocity[3:6],
            model.feet.copy(),
            motion,
            height,
        )
        result = self._mpc.step(self._state, inputs)
        self._state = result.state
        self.failures += result.status is not MpcStatus.SOLVED
        return result.plan


def walk(
    forward: float = 0.0,
    left: float = 0.0,
    yaw_rate: float = 0.0,
    begin: float = 0.5,
    ramp: float = 1.0,
    longest: float = 15.0,
) -> Motion:
    """Return a walk at a velocity in the heading frame, reached by an even ramp.

    Args:
        forward, left: Velocity [m/s].
        yaw_rate: [rad/s], reached by the same ramp.
        begin, ramp: When the ramp begins and how long it takes [s].
        longest: Time up to which the walk is known [s].
    """
    dt = TICK_NS / NS_PER_S
    time = dt * np.arange(round(longest / dt))
    part = np.clip((time - begin) / ramp, 0.0, 1.0)
    yaw = np.cumsum(yaw_rate * part) * dt
    along, across = np.exp(1j * yaw), 1j * np.exp(1j * yaw)
    velocity = part * (forward * along + left * across)
    acceleration = np.gradient(velocity, dt)
    position = np.concatenate(([0.0], np.cumsum(velocity[:-1] + 0.5 * dt * acceleration[:-1]) * dt))

    def at(stamp: int) -> PlannedMotion:
        k = stamp // TICK_NS
        p, v, a = position[k], velocity[k], acceleration[k]
        return PlannedMotion(
            stamp,
            np.array([p.real, p.imag]),
            np.array([v.real, v.imag]),
            np.array([a.real, a.imag]),
            float(yaw[k]),
            float(yaw_rate * part[k]),
        )

    return at


def _row(
    stamp: int,
    model: RobotModel,
    robot: RobotState,
    body: BodyReference,
    motion: PlannedMotion,
    torques: Array,
    forces: Array,
) -> tuple[object, ...]:
    """Return a recording's columns at one tick."""
    r = model.rotation
    roll, pitch = math.atan2(r[2, 1], r[2, 2]), math.asin(max(-1.0, min(1.0, -r[2, 0])))
    return (
        stamp / NS_PER_S,
        model.com.copy(),
        model.com_velocity.copy(),
        body.com,
        (math.degrees(roll), math.degrees(pitch)),
        math.atan2(r[1, 0], r[0, 0]),
        motion.yaw,
        torques,
        forces,
        robot.foot_forces,
    )
