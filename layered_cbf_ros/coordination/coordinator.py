"""The top layer, whole: one step takes everybody's plan one period further."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.coordination.agent_agent import AgentAgent
from layered_cbf_ros.coordination.agent_obstacle import AgentObstacle
from layered_cbf_ros.coordination.agent_wall import AgentWall
from layered_cbf_ros.coordination.alarms import alarmed
from layered_cbf_ros.coordination.barriers import Barrier, Bodies, Scene, stacked
from layered_cbf_ros.coordination.desired_motion import desired_input, desired_twist
from layered_cbf_ros.coordination.exchange import CoordinationInputs, CoordinationResult
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.coordination.plan import (
    CoordinationState,
    advanced,
    coasted,
    input_limits,
    motions,
    seated,
)
from layered_cbf_ros.coordination.planner_qp import (
    PlannerQp,
    QpSolution,
    QpStatus,
    braking_input,
    chosen_input,
    unfiltered,
)
from layered_cbf_ros.coordination.tracked_bodies import bodies_at, heeded_tracks
from layered_cbf_ros.interfaces import NS_PER_S, Array, Track
from layered_cbf_ros.rounding import rounded
from layered_cbf_ros.scenario import Robot, Wall


class Coordinator:
    """Safety-critical coordination of N robots (paper II, III-A to III-D).

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
        """Allocate and warm up one QP for every number of obstacles.

        Args:
            parameters: Gains, limits and settings.
            robots: The agents; those that only stand keep their place.
            walls: Half-planes to stay in.
            rate: Ticks per second [Hz].
            filtered: False takes the desired motion within the input limits as it is,
                whatever it runs into: for the question what the filter is good for.
                No node's parameter sets it.
        """
        names = [robot.name for robot in robots]
        radii = np.array([robot.disc(parameters.agent_radius) for robot in robots])
        self._parameters = parameters
        self._robots = tuple(robots)
        self._standing = np.array([robot.gait == 'stand' for robot in robots], dtype=bool)
        self._rate = rate
        self._is_filtered = filtered
        self._period_ns = NS_PER_S // rate
        self._barriers: tuple[Barrier, ...] = (
            AgentAgent(names, radii, parameters),
            AgentObstacle(names, radii, parameters),
            AgentWall(names, radii, walls, parameters),
        )
        counts = range(parameters.max_obstacles + 1) if filtered else range(0)
        self._problems = [self._problem(count) for count in counts]
        for count in counts:
            self._warm_up(count)

    def start(
        self, stamp_ns: int, positions: Array | None = None, yaws: Array | None = None
    ) -> CoordinationState:
        """Return a plan at rest.

        Args:
            stamp_ns: From here on the wishes grow to their full size [ns].
            positions: Where the robots are [m], (N, 2); NaN or None: at their start.
            yaws: Their headings [rad], (N,); NaN or None: that of their start.
        """
        count = len(self._robots)
        places = np.array([robot.position for robot in self._robots], dtype=float)
        headings = np.array([robot.yaw for robot in self._robots], dtype=float)
        if positions is not None:
            places = np.where(np.isfinite(positions), positions, places)
        if yaws is not None:
            headings = np.where(np.isfinite(yaws), yaws, headings)
        return CoordinationState(
            stamp_ns,
            stamp_ns,
            places,
            np.zeros((count, 2)),
            headings,
            np.zeros(count),
            np.zeros(count, dtype=bool),
            np.zeros(count),
            np.zeros(count),
        )

    def step(self, state: CoordinationState, inputs: CoordinationInputs) -> CoordinationResult:
        """Filter everybody's desired motion and take the plan one period further.

        Args:
            state: Plan handed out by the last step, or by start.
            inputs: Measured states, tracks and commands; their stamp is the tick's.
        """
        p = self._parameters
        state = coasted(state, inputs.stamp_ns, round(p.longest_gap * NS_PER_S))
        state, rejected_states = alarmed(state, inputs, p)
        state = seated(state, inputs.stopped, p.sit_speed, p.sit_time)
        tracks, rejected_tracks, left_out = heeded_tracks(
            inputs.tracks, state.positions, p.max_obstacles
        )
        bodies = bodies_at(inputs.stamp_ns, tracks, p)
        target, yaw_rate, rejected_commands = self._wishes(state, inputs, bodies)
        sits = state.sitting > 0.0
        held = state.frozen | self._standing | sits
        scene = _scene(state, inputs, target, held, bodies)
        rows, ball_labels = stacked([barrier.rows(scene) for barrier in self._barriers])
        u_desired = desired_input(state.velocities, target, p)
        u_desired[held] = 0.0
        coefficients = rows.coefficients.reshape(len(rows.labels), u_desired.size)
        u, solution = self._filtered(state, u_desired, coefficients, rows.bound, len(tracks))
        if inputs.stopped or sits.any():  # no swerving any more
            brake = braking_input(state.velocities, p.stop_brake_time, p.acceleration_limit)
            braked = (sits | inputs.stopped)[:, None]
            u = np.where(braked, rounded(brake, p.input_resolution), u)
        u[state.frozen | self._standing] = 0.0
        turn = (yaw_rate - state.yaw_rates) * self._rate
        turn = np.minimum(np.maximum(turn, -p.yaw_acceleration_limit), p.yaw_acceleration_limit)
        return CoordinationResult(
            state=advanced(state, u, turn, self._period_ns),
            motions=motions(state, u, p.sit_depth),
            target=target,
            u=u,
            u_desired=u_desired,
            held=held,
            labels=rows.labels,
            psi0=rows.psi0,
            psi1=rows.psi1,
            psi2=coefficients @ u.reshape(-1) - rows.bound,
            slack=solution.slack,
            ball_labels=ball_labels,
            q=rows.centre,
            r=rows.radius,
            status=solution.status,
            solver_failed=solution.status is not QpStatus.SOLVED,
            slack_event=bool(solution.slack.max(initial=0.0) > p.slack_tolerance),
            alarms=state.frozen,
            rejected=rejected_states + rejected_tracks + rejected_commands,
            tracks_left_out=left_out,
        )

    def _wishes(
        self, state: CoordinationState, inputs: CoordinationInputs, bodies: Bodies
    ) -> tuple[Array, Array, int]:
        """Return desired velocities (N, 2) and yaw rates (N,), and rejected commands."""
        time = inputs.stamp_ns / NS_PER_S
        ramp = (inputs.stamp_ns - state.start_ns) / NS_PER_S / self._parameters.start_ramp
        places, yaws = state.positions.tolist(), state.yaws.tolist()
        others = places + bodies.position.tolist()
        twists, rejected = [], 0
        for robot, command, place, yaw in zip(
            self._robots, inputs.commands, places, yaws, strict=True
        ):
            bad = command is not None and not command.is_finite()
            rejected += bad
            heeded = None if bad else command
            leader = None if heeded is None else heeded.leader
            heading = yaw if leader is None else yaws[leader]
            twists.append(
                desired_twist(robot.desired, heeded, time, place, heading, others, self._parameters)
            )
        wishes = np.array(twists) * min(1.0, ramp)
        wishes[state.frozen | self._standing | (state.sitting > 0.0) | inputs.stopped] = 0.0
        return wishes[:, :2], wishes[:, 2], rejected

    def _filtered(
        self,
        state: CoordinationState,
        u_desired: Array,
        coefficients: Array,
        bound: Array,
        bodies: int,
    ) -> tuple[Array, QpSolution]:
        """Return the applied inputs (N, 2) and the solution of the QP."""
        p = self._parameters
        limits = input_limits(
            state.velocities, p.acceleration_limit, p.speed_limit, 1.0 / self._rate
        )
        if not self._is_filtered:
            solution = unfiltered(u_desired.reshape(-1), len(bound), *limits)
            return rounded(solution.u.reshape(-1, 2), p.input_resolution), solution
        problem = self._problems[bodies]
        solution = problem.solve(u_desired.reshape(-1), coefficients, bound, *limits)
        brake = braking_input(state.velocities, p.brake_time, p.acceleration_limit)
        return rounded(chosen_input(solution, brake), p.input_resolution), solution

    def _problem(self, bodies: int) -> PlannerQp:
        """Return the workspace for a number of bodies."""
        weights = [np.full(barrier.size(bodies), barrier.weight) for barrier in self._barriers]
        return PlannerQp(2 * len(self._robots), np.concatenate(weights), self._parameters)

    def _warm_up(self, bodies: int) -> None:
        """Step once among far, slow bodies: the first solve of a workspace is slow."""
        count = len(self._robots)
        state = self.start(0)
        angles = np.arange(bodies) + 0.5
        places = state.positions[0] + 5.0 * np.column_stack((np.cos(angles), np.sin(angles)))
        covariance, still = np.zeros((4, 4)), np.zeros(2)
        tracks = tuple(
            Track(f'rehearsal_{k}', 0, place, still, covariance, 0.3)
            for k, place in enumerate(places)
        )
        upright, nobody = np.zeros(count, dtype=bool), (None,) * count
        known = state.positions, state.velocities
        self.step(state, CoordinationInputs(0, *known, upright, tracks, nobody, state.yaws))


def _scene(
    state: CoordinationState,
    inputs: CoordinationInputs,
    target: Array,
    held: NDArray[np.bool_],
    bodies: Bodies,
) -> Scene:
    """Return what the barriers see; frozen robots move as measured, if that is known."""
    any_held = bool(held.any())
    velocity = state.velocities
    if any_held:
        measured = state.frozen & np.isfinite(inputs.velocities).all(axis=1)
        velocity = np.where(measured[:, None], inputs.velocities, velocity)
    return Scene(state.positions, velocity, target, held, any_held, bodies)
