"""The coordinator as it runs in the graph: from everybody's state to one tick's result.

The coordinator node and whoever repeats its ticks from a bag both use this.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.coordination.coordinator import Coordinator
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.plan import CoordinationState
from layered_cbf_ros.interfaces import Array, BaseState, RobotState, Track, VelocityCommand
from layered_cbf_ros.robot_model import RobotModel, has_fallen, yaw_of
from layered_cbf_ros.scenario import Robot, Wall

AXES = ('x', 'y')
Commands = tuple[VelocityCommand | None, ...]


class CoordinationLayer:
    """Gives the coordinator the centres of mass of all robots.

    Its only memory is the solver's workspaces; the plan is handed in and out.
    """

    def __init__(
        self,
        parameters: CoordinatorParameters,
        robots: Sequence[Robot],
        walls: Sequence[Wall],
        rate: int = 1000,
        filtered: bool = True,
    ) -> None:
        """Make the coordinator; the arguments are its own."""
        self._coordinator = Coordinator(parameters, robots, walls, rate, filtered)
        self._model = RobotModel()

    def step(
        self,
        memory: CoordinationState | None,
        stamp_ns: int,
        states: Sequence[RobotState | None],
        tracks: tuple[Track, ...],
        commands: Commands | None = None,
        stopped: bool = False,
    ) -> CoordinationResult:
        """Filter everybody's desired motion at the stamp of their states.

        Args:
            memory: State of the last result; None at the first tick, which plans from
                where the robots are.
            stamp_ns: Stamp of the states [ns].
            states: Of each robot, None where it isn't known.
            tracks: Everybody else.
            commands: A velocity asked of each robot, or None; None for no commands at all.
            stopped: The emergency stop.
        """
        return self.act(memory, self.inputs(stamp_ns, states, tracks, commands, stopped))

    def act(
        self, memory: CoordinationState | None, inputs: CoordinationInputs
    ) -> CoordinationResult:
        """Return the result of one tick, like step, from the coordinator's own inputs."""
        memory = memory or self._coordinator.start(inputs.stamp_ns, inputs.positions, inputs.yaws)
        return self._coordinator.step(memory, inputs)

    def inputs(
        self,
        stamp_ns: int,
        states: Sequence[RobotState | None],
        tracks: tuple[Track, ...],
        commands: Commands | None = None,
        stopped: bool = False,
    ) -> CoordinationInputs:
        """Return what the coordinator needs: CoM of every robot whose state is known."""
        positions, velocities = (np.full((len(states), 2), np.nan) for _ in range(2))
        yaws = np.full(len(states), np.nan)
        fallen = np.zeros(len(states), dtype=bool)
        for i, state in enumerate(states):
            if state is not None:
                self._model.update_kinematics(state.configuration, state.velocity)
                positions[i] = self._model.com[:2]
                velocities[i] = self._model.com_velocity[:2]
                yaws[i] = yaw_of(self._model.rotation)
                fallen[i] = has_fallen(state.configuration)
        commands = commands or (None,) * len(states)
        return CoordinationInputs(
            stamp_ns, positions, velocities, fallen, tracks, commands, yaws, stopped
        )

    def inputs_of_bases(
        self,
        stamp_ns: int,
        bases: Sequence[BaseState | None],
        tracks: tuple[Track, ...],
        commands: Commands | None = None,
        stopped: bool = False,
    ) -> CoordinationInputs:
        """Return what the coordinator needs of robots with their own locomotion.

        One of which nothing is known counts as a robot that doesn't answer.
        """
        positions, velocities = (np.full((len(bases), 2), np.nan) for _ in range(2))
        yaws = np.full(len(bases), np.nan)
        for i, base in enumerate(bases):
            if base is not None:
                positions[i], velocities[i], yaws[i] = base.position, base.velocity, base.yaw
        commands = commands or (None,) * len(bases)
        silent = np.isnan(yaws)
        return CoordinationInputs(
            stamp_ns, positions, velocities, silent, tracks, commands, yaws, stopped
        )


def axis_names(robots: Sequence[str]) -> list[str]:
    """Return the names of the values of `wishes`."""
    return [f'{name}/{axis}' for name in robots for axis in AXES]


def wishes(result: CoordinationResult) -> tuple[Array, Array, Array, Array]:
    """Return what /coordinator/desired tells of a tick, robot by robot and axis by axis.

    Positions hold the applied input, velocities the desired velocity, accelerations the
    desired input; effort is 1 for a robot that can't obey.
    """
    held = np.repeat(result.held.astype(float), 2)
    return result.u.ravel(), result.target.ravel(), result.u_desired.ravel(), held


def interventions(result: CoordinationResult) -> tuple[Array]:
    """Return what /coordinator/intervention tells: |u - u_desired| of each robot [m/s^2]."""
    return (np.hypot(*(result.u - result.u_desired).T),)


def barriers(result: CoordinationResult) -> tuple[Array, Array, Array, Array]:
    """Return what /coordinator/barriers tells of each row."""
    return result.psi0, result.psi1, result.psi2, result.slack
