"""One robot's three layers and the simulated plant in one process, with an emergency stop.

The layers are coupled with the latencies of the node graph: torques act one tick after
their state, forces are 2 to 3 ms old, the plan 1 to 2 ms. Who is silent is missed after
50 ms, as in real time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from layered_cbf_ros.coordination.coordination_layer import CoordinationLayer
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.ground_forces.force_layer import ForceLayer
from layered_cbf_ros.ground_forces.ground_force_mpc import MpcStatus
from layered_cbf_ros.ground_forces.parameters import GroundForceParameters
from layered_cbf_ros.interfaces import NS_PER_S, VelocityCommand
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Robot, Scenario, World
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters
from layered_cbf_ros.whole_body.torque_layer import TorqueLayer

TICK_NS = 1_000_000
AGE_LIMIT_NS = 50 * TICK_NS


def always(_: float) -> bool:
    return True


@dataclass
class Stopping:
    """What happens to the robot; all functions take the time [s].

    Attributes:
        stopped: Whether the emergency stop is latched.
        speed: Forward velocity asked for [m/s].
        coordinator_alive, mpc_alive: Whether they answer; a coordinator that comes back
            is a new one and knows nothing.
        world: Ground and pushes; pushes are for robot 'a1'.
        payload: Extra trunk mass that the controllers don't know [kg].
        coordinator, mpc, wbc: Parameters of the layers.
    """

    stopped: Callable[[float], bool]
    speed: float = 0.5
    coordinator_alive: Callable[[float], bool] = always
    mpc_alive: Callable[[float], bool] = always
    world: World = field(default_factory=World)
    payload: float = 0.0
    coordinator: CoordinatorParameters = field(default_factory=CoordinatorParameters)
    mpc: GroundForceParameters = field(default_factory=GroundForceParameters)
    wbc: WholeBodyParameters = field(default_factory=WholeBodyParameters)

    def run(self, duration: float) -> dict[str, np.ndarray]:
        """Simulate from a nominal stance at the origin.

        Returns:
            A row a tick: time [s], com [m] and com_velocity [m/s] (3), base height [m],
            tilt [deg], torques [Nm] (12), joints [rad] (12), joint_speed [rad/s] (12), feet:
            normal forces [N] (4), belly: normal force on anything but a toe [N], plan_height
            [m], plan_climb [m/s], plan_speed [m/s], solved by MPC and WBC (2), status of the
            whole-body controller.
        """
        robot = Robot('a1', (0.0, 0.0), 0.0, payload=self.payload)
        scenario = Scenario(
            'stopping', '', 0, duration, 'lockstep', 'bullet', 0.1, (robot,), world=self.world
        )
        start = RobotModel().nominal_configuration(np.zeros(2), 0.0, self.wbc.com_height)
        plant = BulletWorld(scenario, SimulatorParameters(exact_within=0.0), [start])
        try:
            return self._simulate(plant, robot, round(duration * NS_PER_S / TICK_NS))
        finally:
            plant.close()

    def _simulate(self, plant: BulletWorld, robot: Robot, ticks: int) -> dict[str, np.ndarray]:
        top = CoordinationLayer(self.coordinator, (robot,), ())
        middle, bottom = ForceLayer(self.mpc), TorqueLayer(self.wbc)
        plans, forces, model = [], [], RobotModel()
        top_memory = middle_memory = bottom_memory = None
        torques, rows = np.zeros(12), []
        for tick in range(ticks):
            stamp, time = tick * TICK_NS, tick * TICK_NS / NS_PER_S
            (state,) = plant.states()
            model.update_kinematics(state.configuration, state.velocity)
            plan, force = newest(plans, stamp, TICK_NS), newest(forces, stamp, 2 * TICK_NS)
            bottom_memory, result = bottom.step(bottom_memory, state, plan, force)
            mpc_solved = True
            if tick % 2 == 0 and self.mpc_alive(time):
                middle_memory, forced = middle.step(middle_memory, state, plan)
                mpc_solved = forced.status is MpcStatus.SOLVED
                forces.append(forced.plan)
            if self.coordinator_alive(time):
                inputs = replace(
                    top.inputs(stamp, [state], ()),
                    commands=(VelocityCommand(self.speed, 0.0),),
                    stopped=self.stopped(time),
                )
                planned = top.act(top_memory, inputs)
                top_memory = planned.state
                if tick % 2 == 0:
                    plans.append(planned.motions[0])
            else:
                top_memory = None
            told = plans[-1]
            row = {
                'time': time,
                'com': model.com.copy(),
                'com_velocity': model.com_velocity.copy(),
                'base': state.configuration[2],
                'tilt': tilt_of(model.rotation),
                'torques': result.torques,
                'joints': state.configuration[7:],
                'joint_speed': state.velocity[6:],
                'feet': state.foot_forces,
                'belly': float(plant.clearances().forces[-1]),
                'plan_height': told.height,
                'plan_climb': told.vertical_velocity,
                'plan_speed': math.hypot(*told.velocity),
                'solved': (mpc_solved, result.solved),
                'status': result.status,
            }
            rows.append(row)
            plant.step(torques[None])
            torques = result.torques
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def newest(messages: list, stamp: int, latency: int):
    """Return the newest message that is old enough, unless it is too old."""
    usable = [m for m in messages[-4:] if m.stamp_ns <= stamp - latency]
    return usable[-1] if usable and stamp - usable[-1].stamp_ns <= AGE_LIMIT_NS else None


def tilt_of(rotation: np.ndarray) -> float:
    """Return the angle between the trunk's z axis and the vertical [deg]."""
    return math.degrees(math.acos(max(-1.0, min(1.0, rotation[2, 2]))))
