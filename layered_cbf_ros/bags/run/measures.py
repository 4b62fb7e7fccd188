"""Figures of a run, each computed from its record alone."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.message_form import EFFORT, POSITION
from layered_cbf_ros.bags.run.motions import RobotMotion
from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.bags.run.stops import told_to_sit
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.robot_model import FALLEN_HEIGHT, FALLEN_TILT, RobotModel
from layered_cbf_ros.scenario import HARDWARE, Scenario

SAMPLE_NS = 10_000_000
STANDING_HEIGHT = 0.24
"""A base at this height or above is that of a robot on its feet [m]."""


@dataclass(frozen=True, slots=True)
class Fall:
    """A robot fell.

    Attributes:
        robot: Which.
        time_s: When first, since the first state [s].
        reason: How it was seen.
    """

    robot: str
    time_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies touched.

    Attributes:
        pair: `a~b`.
        time_s: When first, since the first state [s].
        force_n: Largest normal force [N].
    """

    pair: str
    time_s: float
    force_n: float


def roll_pitch_tilt(quaternions: Array) -> tuple[Array, Array, Array]:
    """Return roll and pitch of R = Rz(yaw) Ry(pitch) Rx(roll), and tilt [rad], (k,) each.

    The third row of R is (-sin pitch, cos pitch sin roll, cos pitch cos roll);
    tilt is the angle between the trunk's z axis and the vertical.

    Args:
        quaternions: x, y, z, w, base to world, (k, 4).
    """
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    row = (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y))
    roll = np.arctan2(row[1], row[2])
    pitch = -np.arcsin(np.clip(row[0], -1.0, 1.0))
    return roll, pitch, np.arccos(np.clip(row[2], -1.0, 1.0))


def goal_times(record: RunRecord, scenario: Scenario) -> dict[str, float | None]:
    """Return when each robot with a goal first came within its tolerance [s], or None."""
    times: dict[str, float | None] = {}
    for robot in scenario.robots:
        if robot.desired.goal is None:
            continue
        times[robot.name] = None
        motion = record.motions.get(robot.name)
        if motion is not None:
            left = np.hypot(*(motion.configurations[:, :2] - robot.desired.goal).T)
            reached = np.flatnonzero(left <= scenario.goal_tolerance)
            if len(reached):
                times[robot.name] = float(record.seconds(motion.stamps_ns[reached[:1]])[0])
    return times


def find_falls(record: RunRecord) -> tuple[Fall, ...]:
    """Return the first fall of each robot: tilted, low, or on the ground with a body part.

    One that is told to sit may be low and lie on its belly, but not tip over. One at the
    other end of a wire lies until its driver stands it up; it counts from then on.
    """
    falls = []
    tilted = f'trunk tilted beyond {np.rad2deg(FALLEN_TILT):.0f} deg'
    low = f'base below {FALLEN_HEIGHT} m'
    legged = {name: motion for name, motion in record.motions.items() if motion.has_legs}
    for robot, motion in legged.items():
        times = record.seconds(motion.stamps_ns)
        tilt = roll_pitch_tilt(motion.configurations[:, 3:7])[2]
        height = motion.configurations[:, 2]
        stood_ns = stood_up_ns(record, motion)
        sits = told_to_sit(record.plan, robot, motion.stamps_ns) | (motion.stamps_ns < stood_ns)
        found = [
            *_first_fall(robot, times, tilt > FALLEN_TILT, tilted),
            *_first_fall(robot, times, (height < FALLEN_HEIGHT) & ~sits, low),
            *_ground_touched(record, robot, stood_ns),
        ]
        if stood_ns > motion.stamps_ns[-1]:
            found.append(Fall(robot, float(times[-1]), 'it never stood up'))
        falls += sorted(found, key=lambda fall: fall.time_s)[:1]
    return tuple(falls)


def stood_up_ns(record: RunRecord, motion: RobotMotion) -> int:
    """Return when a robot first stood [ns]: a robot with a driver begins on its belly.

    After the last state if it never did; the stamp of the first if it didn't lie then.
    """
    wired = record.scenario is not None and record.scenario.plant in HARDWARE
    if not wired or motion.configurations[0, 2] >= STANDING_HEIGHT:
        return int(motion.stamps_ns[0])
    stands = np.flatnonzero(motion.configurations[:, 2] >= STANDING_HEIGHT)
    return int(motion.stamps_ns[stands[0]] if len(stands) else motion.stamps_ns[-1] + 1)


def find_contacts(record: RunRecord) -> tuple[Contact, ...]:
    """Return the pairs of robots, obstacles and walls that touched."""
    return tuple(contact for contact in _contacts(record) if not _is_ground(contact.pair))


def smallest_clearance(record: RunRecord) -> tuple[float, str] | None:
    """Return the smallest surface distance [m] and its pair, ground left out."""
    clearance = record.clearance
    if clearance is None:
        return None
    columns = [i for i, name in enumerate(clearance.names) if not _is_ground(name)]
    distances = clearance.values[:, POSITION, columns]
    if not distances.size or bool(np.isnan(distances).all()):
        return None
    _, k = np.unravel_index(np.nanargmin(distances), distances.shape)
    return float(np.nanmin(distances)), clearance.names[columns[int(k)]]


def centres_of_mass(model: RobotModel, motion: RobotMotion, rows: NDArray[np.intp]) -> Array:
    """Return the CoM in the world at some rows of a motion [m], (len(rows), 3)."""
    positions, velocities = np.empty((len(rows), 3)), motion.velocities
    for position, row in zip(positions, rows, strict=True):
        model.update_kinematics(motion.configurations[row], velocities[row])
        position[:] = model.com
    return positions


def largest_plan_error(record: RunRecord) -> float | None:
    """Return the largest distance in the plane of a CoM, or a disc, from its plan [m].

    State and plan are compared at equal stamps, 10 ms apart.
    """
    plan, state = record.plan, record.state
    if plan is None or state is None:
        return None
    _, rows, planned = np.intersect1d(state.stamps_ns, plan.stamps_ns, return_indices=True)
    samples = np.unique(state.stamps_ns[rows] // SAMPLE_NS, return_index=True)[1]
    rows, planned = rows[samples], planned[samples]
    robots = [name for name in record.motions if name in plan.names]
    if not robots or not len(rows):
        return None
    model, errors = RobotModel(), []
    for robot in robots:
        motion = record.motions[robot]
        com = motion.configurations[rows]
        if motion.has_legs:
            com = centres_of_mass(model, motion, rows)
        error = plan.values[planned, :2, plan.names.index(robot)] - com[:, :2]
        errors.append(np.hypot(*error.T).max())
    return float(np.max(errors))


def trajectory_sha256(state: Series) -> str:
    """Return the hash of a run's motion: names, stamps and all doubles of /state.

    Decoded values are hashed, in stamp order, each stamp once: neither padding
    bytes nor a message sent twice changes it; any changed bit of a double does.
    """
    digest = hashlib.sha256('\n'.join(state.names).encode())
    digest.update(np.ascontiguousarray(state.stamps_ns, '<i8').data)
    digest.update(np.ascontiguousarray(state.values, '<f8').data)
    return digest.hexdigest()


def missing_states(state: Series) -> int:
    """Return how many states are absent, by gaps larger than the usual step."""
    steps = np.diff(state.stamps_ns)
    if not len(steps):
        return 0
    usual = np.median(steps)
    return int(np.sum(np.round(steps / usual).astype(np.int64) - 1))


def longest_gap(series: Series, first_ns: int, last_ns: int) -> float:
    """Return the longest time within [first, last] without a message [s]."""
    stamps = np.concatenate(([first_ns], series.stamps_ns, [last_ns]))
    return float(np.diff(np.sort(stamps)).max()) / NS_PER_S


def _contacts(record: RunRecord) -> list[Contact]:
    clearance = record.clearance
    if clearance is None:
        return []
    times = record.seconds(clearance.stamps_ns)
    contacts = []
    for name, forces in zip(clearance.names, clearance.values[:, -1].T, strict=True):
        touching = np.flatnonzero(forces > 0.0)
        if len(touching):
            contacts.append(Contact(name, float(times[touching[0]]), float(np.nanmax(forces))))
    return contacts


def _ground_touched(record: RunRecord, robot: str, from_ns: int) -> list[Fall]:
    """Return when a robot's body first touched the ground, from a time on, untold."""
    clearance, pair = record.clearance, f'{robot}~ground'
    if clearance is None or pair not in clearance.names:
        return []
    touching = clearance.values[:, EFFORT, clearance.names.index(pair)] > 0.0
    touching &= ~told_to_sit(record.plan, robot, clearance.stamps_ns)
    touching &= clearance.stamps_ns >= from_ns
    times = record.seconds(clearance.stamps_ns)
    return _first_fall(robot, times, touching, 'ground touched by more than feet')


def _is_ground(pair: str) -> bool:
    return pair.endswith('~ground')


def _first_fall(robot: str, times: Array, fallen: NDArray[np.bool_], reason: str) -> list[Fall]:
    rows = np.flatnonzero(fallen)
    return [Fall(robot, float(times[rows[0]]), reason)] if len(rows) else []
