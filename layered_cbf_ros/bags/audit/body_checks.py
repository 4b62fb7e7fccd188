"""Does each robot follow its plan, upright, within what its joints can do?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.body_geometry import BodyGeometry, Centres, rotations_of
from layered_cbf_ros.bags.audit.evidence import COMMANDS, Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_least, at_most, not_proven
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import RunParameters
from layered_cbf_ros.bags.audit.world import Motions
from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.node_topics import PLAN

PLANNED_HEIGHT = 2
ROLL, PITCH, HEIGHT = 'roll', 'pitch', 'trunk height'
URDF = 'range from the URDF in pybullet_data, which agrees with that of the maker'


def check_plan_error(
    evidence: Evidence, motions: Motions, geometry: Centres, limits: Limits
) -> Check:
    """Check that every CoM stays near its plan, at equal stamps, in the plane."""
    name = 'plan error'
    trace = evidence.traces.get(PLAN)
    if trace is None:
        return not_proven(name, f'no {PLAN}')
    series, holes = trace.series, list(motions.holes)
    stamps, rows, planned = np.intersect1d(motions.stamps_ns, series.stamps_ns, return_indices=True)
    samples = []
    for robot, configurations in motions.robots.items():
        if robot not in series.names:
            holes.append(f'{PLAN} has no robot {robot}')
            continue
        com = geometry.centres_of_mass(configurations[rows])[:, :2]
        plan = series.values[planned, :2, series.names.index(robot)]
        error = np.linalg.norm(plan - com, axis=1)
        samples.append(Samples(robot, evidence.seconds(stamps), error, limits.plan_error))
    return at_most(name, 'm', samples, holes)


def check_posture(evidence: Evidence, motions: Motions, limits: Limits) -> list[Check]:
    """Check roll, pitch and height of every trunk; who is told to sit may be low."""
    rolls, pitches, heights = [], [], []
    for robot, q in motions.robots.items():
        rotation = rotations_of(q[:, 3:7])
        # R = Rz(yaw) Ry(pitch) Rx(roll): its last row is (-sin p, cos p sin r, cos p cos r)
        roll = np.degrees(np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2]))
        pitch = np.degrees(np.arctan2(-rotation[:, 2, 0], np.hypot(*rotation[:, 2, 1:].T)))
        rolls.append(Samples(robot, motions.times, np.abs(roll), limits.tilt))
        pitches.append(Samples(robot, motions.times, np.abs(pitch), limits.tilt))
        up = ~_told_to_sit(evidence, robot, motions.stamps_ns)
        heights.append(Samples(robot, motions.times[up], q[up, 2], limits.height))
    return [
        at_most(ROLL, 'deg', rolls, motions.holes),
        at_most(PITCH, 'deg', pitches, motions.holes),
        at_least(HEIGHT, 'm', heights, motions.holes),
    ]


def _told_to_sit(evidence: Evidence, robot: str, stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell at which stamps the plan in force is below standing height, (k,)."""
    trace = evidence.traces.get(PLAN)
    if trace is None or robot not in trace.series.names:
        return np.zeros(len(stamps_ns), dtype=bool)
    height = trace.series.values[:, PLANNED_HEIGHT, trace.series.names.index(robot)]
    stamps = np.concatenate(([-1], trace.series.stamps_ns))
    in_force = np.concatenate(([0.0], height))[np.searchsorted(stamps, stamps_ns, 'right') - 1]
    lower: NDArray[np.bool_] = in_force < 0.0
    return lower


def check_joints(motions: Motions, geometry: BodyGeometry, limits: Limits) -> list[Check]:
    """Check measured torque, angle and speed of every joint."""
    torques, angles, speeds = [], [], []
    for robot, q in motions.robots.items():
        for k, joint in enumerate(JOINT_NAMES):
            subject, angle = f'{robot}/{joint}', q[:, 7 + k]
            torque = np.abs(motions.torques[robot][:, k])
            torques.append(Samples(subject, motions.times, torque, limits.torque))
            beyond = np.maximum(geometry.lower[k] - angle, angle - geometry.upper[k])
            angles.append(Samples(subject, motions.times, beyond, limits.joint_excess))
            speed = np.abs(motions.velocities[robot][:, 6 + k])
            speeds.append(Samples(subject, motions.times, speed, limits.joint_speed))
    return [
        at_most('measured torque', 'Nm', torques, motions.holes),
        at_most('joint angle beyond range', 'rad', angles, motions.holes, [URDF]),
        at_most('joint speed', 'rad/s', speeds, motions.holes),
    ]


def check_commands(evidence: Evidence, run: RunParameters | None, limits: Limits) -> Check:
    """Check the torque of every command; the smaller limit of run and user counts."""
    limit = limits.torque if run is None else min(limits.torque, run.torque_limit)
    samples, holes = [], []
    for robot in evidence.robots:
        trace = evidence.traces.get(f'/{robot}/{COMMANDS}')
        if trace is None:
            holes.append(f'no /{robot}/{COMMANDS}')
            continue
        times = evidence.seconds(trace.series.stamps_ns)
        for k, joint in enumerate(trace.series.names):
            torque = np.abs(trace.series.values[:, 1, k])
            samples.append(Samples(f'{robot}/{joint}', times, torque, limit))
    return at_most('commanded torque', 'Nm', samples, holes)
