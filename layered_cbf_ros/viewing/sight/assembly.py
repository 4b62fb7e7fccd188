"""From rows of recorded or live messages to all that is to be seen at one instant.

The live viewer and the one of a bag have the same rows, so they show the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from layered_cbf_ros.coordination.coordination_layer import axis_names
from layered_cbf_ros.discs import disc_radii
from layered_cbf_ros.interfaces import JOINT_NAMES, Array
from layered_cbf_ros.messages.ground_forces import FEET
from layered_cbf_ros.messages.ground_forces import NAMES as FORCE_NAMES
from layered_cbf_ros.messages.robot_state import BASE_NAMES, STATE_NAMES, VELOCITIES
from layered_cbf_ros.node_topics import (
    BALLS,
    BARRIERS,
    CLEARANCE,
    COMMANDS,
    DESIRED,
    INTERVENTION,
    PLAN,
)
from layered_cbf_ros.operation.told import read_told
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import LEGGED, Scenario
from layered_cbf_ros.viewing.sight.reach import coordinator_parameters, reach_ball
from layered_cbf_ros.viewing.sight.rows import Row, forces_topic, planned_motion, state_topic
from layered_cbf_ros.viewing.sight.snapshot import (
    BallSight,
    BarrierSight,
    NodeSight,
    ObstacleSight,
    RobotSight,
    Snapshot,
)

POSITION, VELOCITY, ACCELERATION, EFFORT = range(4)
EFFORT_OF_STATE = 2  # a JointState has no accelerations
BASE, JOINTS = len(BASE_NAMES), len(JOINT_NAMES)
"""Entries of a configuration."""


@dataclass(frozen=True, slots=True)
class Told:
    """What the coordinator did with what an operator asks for.

    Attributes:
        steered: Whether each robot is commanded.
        is_stopped: Whether the emergency stop is latched.
    """

    steered: tuple[bool, ...]
    is_stopped: bool


@dataclass(frozen=True, slots=True)
class Body:
    """Where one robot is and how it moves.

    Attributes:
        configuration: As in RobotState, (19,).
        position, velocity: Of its CoM in the world plane [m], [m/s], (2,) each.
        feet: Toe centres in the world [m], (4, 3).
        has_legs: Whether it has any.
    """

    configuration: Array
    position: Array
    velocity: Array
    feet: Array
    has_legs: bool


class Assembler:
    """Makes snapshots of one run; its only memory is the robot model's workspace."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._robots = [robot.name for robot in scenario.robots]
        self._parameters = coordinator_parameters(scenario)
        self._radii = disc_radii(scenario)
        self._model = RobotModel()

    def snapshot(
        self,
        stamp_ns: int,
        rows: Mapping[str, Row],
        obstacles: tuple[ObstacleSight, ...],
        nodes: tuple[NodeSight, ...],
        is_paused: bool = False,
    ) -> Snapshot:
        """Return what is to be seen.

        Args:
            stamp_ns: The time to show [ns].
            rows: The newest row of each topic at that time.
            obstacles, nodes, is_paused: As in Snapshot.
        """
        told = self._told(rows.get(COMMANDS))
        barriers = _barriers(rows.get(BARRIERS))
        return Snapshot(
            stamp_ns,
            self._all_robots(rows, told),
            obstacles,
            self._scenario.walls,
            _balls(rows.get(BALLS), {b.label: b.psi0 for b in barriers}),
            barriers,
            _distances(rows.get(CLEARANCE)),
            nodes,
            told.is_stopped,
            is_paused,
        )

    def _told(self, row: Row | None) -> Told:
        if row is None:
            return Told((False,) * len(self._robots), False)
        fields = row.values[VELOCITY], row.values[EFFORT]
        commands, is_stopped = read_told(list(row.names), *fields, self._robots)
        return Told(tuple(command is not None for command in commands), is_stopped)

    def _all_robots(self, rows: Mapping[str, Row], told: Told) -> tuple[RobotSight, ...]:
        """Return every robot whose state is known."""
        sights = []
        for robot, is_steered in zip(self._scenario.robots, told.steered, strict=True):
            row = rows.get(state_topic(robot))
            if row is None:
                continue
            entries = row.picked([f'{robot.name}/{entry}' for entry in STATE_NAMES])
            if np.isfinite(entries[POSITION, :BASE]).all():
                body = self._body(np.nan_to_num(entries), robot.kind == LEGGED)
                sights.append(self._robot(robot.name, body, rows, is_steered))
        return tuple(sights)

    def _body(self, entries: Array, has_legs: bool) -> Body:
        """Return where a body is and how it moves, from its entries in /state."""
        configuration = entries[POSITION, : BASE + JOINTS]
        velocity = entries[VELOCITY, VELOCITIES]
        self._model.update_kinematics(configuration, velocity)
        if has_legs:
            com, com_velocity = self._model.com[:2].copy(), self._model.com_velocity[:2].copy()
            return Body(configuration, com, com_velocity, self._model.feet.copy(), True)
        in_world = (self._model.rotation @ velocity[:3])[:2]
        return Body(configuration, configuration[:2], in_world, np.zeros((4, 3)), False)

    def _robot(
        self, name: str, body: Body, rows: Mapping[str, Row], is_steered: bool
    ) -> RobotSight:
        wish = _picked(rows, DESIRED, axis_names([name]), 4)
        target, is_held = wish[VELOCITY], bool(wish[EFFORT].any())
        plan = planned_motion(rows.get(PLAN), name)
        start = body.position if plan is None else plan.position
        speed = body.velocity if plan is None else plan.velocity
        return RobotSight(
            name,
            body.configuration,
            body.velocity,
            body.feet,
            _foot_forces(rows.get(forces_topic(name))),
            body.has_legs,
            self._radii[name],
            plan,
            target,
            reach_ball(start, speed, target, is_held, self._parameters),
            float(_picked(rows, INTERVENTION, [name], 4)[POSITION, 0]),
            is_held,
            is_steered,
        )


def _picked(rows: Mapping[str, Row], topic: str, names: list[str], fields: int) -> Array:
    """Return the values of some names, zero where they aren't known."""
    row = rows.get(topic)
    return np.zeros((fields, len(names))) if row is None else np.nan_to_num(row.picked(names))


def _foot_forces(row: Row | None) -> Array:
    """Return the planned force on each foot in the world [N], (4, 3)."""
    if row is None:
        return np.zeros((4, 3))
    forces = row.picked(list(FORCE_NAMES[FEET]))[EFFORT_OF_STATE]
    return np.nan_to_num(forces).reshape(4, 3)


def _barriers(row: Row | None) -> tuple[BarrierSight, ...]:
    if row is None:
        return ()
    return tuple(
        BarrierSight(label, *map(float, values))
        for label, values in zip(row.names, row.values.T, strict=True)
    )


def _balls(row: Row | None, h: Mapping[str, float]) -> tuple[BallSight, ...]:
    """Return the balls of pairs whose barrier is known too."""
    if row is None:
        return ()
    values = dict(zip(row.names, row.values[POSITION].tolist(), strict=True))
    sights = []
    for name, radius in values.items():
        label, _, axis = name.rpartition('/')
        x, y = values.get(f'{label}/q_x'), values.get(f'{label}/q_y')
        if axis == 'r' and x is not None and y is not None and label in h:
            sights.append(BallSight(label, np.array([x, y]), radius, h[label]))
    return tuple(sights)


def _distances(row: Row | None) -> dict[str, float]:
    """Return the surface distance of each pair, but for the ground below the robots."""
    if row is None:
        return {}
    pairs = zip(row.names, row.values[POSITION].tolist(), strict=True)
    return {label: distance for label, distance in pairs if not label.endswith('~ground')}
