"""Physics, simulated: the same on every machine.

Robots, reference motions and independent oracles are those of the tests.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import test_ground_force_mpc as hovering
import test_robot_model as accelerating
import test_single_rigid_body as rigid
from closed_loop import ClosedLoop, Recording, walk
from test_locomotion import SETTLED, STAND, TRUNK_MASS, mean_velocity

from benchmarks.row import Row
from layered_cbf_ros.ground_forces.single_rigid_body import SingleRigidBody, derivative
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.robot_model import FALLEN_HEIGHT, RobotModel
from layered_cbf_ros.scenario import Push, World
from layered_cbf_ros.whole_body.parameters import WholeBodyParameters

MM = 1e3
TROTS = {
    'on the spot': {},
    '0.4 m/s forward': {'forward': 0.4},
    '0.8 m/s forward': {'forward': 0.8},
    '0.3 m/s to the left': {'left': 0.3},
    'turning at 0.5 rad/s': {'yaw_rate': 0.5},
}


def acceleration_rows() -> list[Row]:
    """Compare pinocchio's and Bullet's accelerations, relative to the largest."""
    model, rng, errors = RobotModel(), np.random.default_rng(0), []
    for seed in range(20):
        q, v = accelerating.random_state(seed)
        torques = 5.0 * rng.normal(size=12)
        model.update(q, v)
        effort = np.concatenate((np.zeros(6), torques))
        expected = np.linalg.solve(model.mass_matrix, effort - model.bias)
        found = accelerating.bullet_acceleration(q, v, torques, model.rotation.copy())
        errors.append(np.abs(found - expected).max() / np.abs(expected).max())
    return [Row('pinocchio against Bullet: acceleration', max(errors), '', 1e-3, 1e-5)]


def stand_rows() -> list[Row]:
    """Stand still for 2 s."""
    run = ClosedLoop(walk(), mpc=STAND).run(2.0)
    error = MM * np.abs(run.after(1.0).error).max()
    return [Row('stand: CoM error', error, 'mm', 2.0, 0.1)]


def trot_rows() -> list[Row]:
    """Trot for 10 s in several ways."""
    rows = []
    for name, velocity in TROTS.items():
        run = ClosedLoop(walk(**velocity)).run(10.0)
        rows += [
            *_speed_error(f'trot {name}', run.after(SETTLED), velocity),
            Row(f'trot {name}: roll, pitch', np.abs(run.tilt).max(), 'deg', 3.0, 0.3),
            Row(f'trot {name}: position error', _astray(run), 'mm', 30.0, 8.0),
            Row(f'trot {name}: torque', np.abs(run.torques).max(), 'Nm', 33.5, 20.0),
            Row(f'trot {name}: solver failures', run.failures, '', 0.0, 0.0),
        ]
    return rows


def push_rows() -> list[Row]:
    """Push the walking robot from the side for 0.1 s."""
    rows = []
    for force in (60.0, 150.0):
        world = World(pushes=(Push('a1', 2.05, 0.1, (0.0, force, 0.0)),))
        run = ClosedLoop(walk(forward=0.4), world=world).run(6.0)
        rows += _survival(f'push of {force:.0f} N', run)
    return rows


def friction_rows() -> list[Row]:
    """Walk on slippery and on usual ground."""
    rows = []
    for friction in (0.4, 0.8):
        run = ClosedLoop(walk(forward=0.4), world=World(friction=friction)).run(4.0)
        rows += _survival(f'friction {friction}', run)
    return rows


def payload_rows() -> list[Row]:
    """Walk with a trunk that is lighter or heavier than the controllers know."""
    rows = []
    for part in (-0.2, 0.2):
        run = ClosedLoop(walk(forward=0.4), payload=part * TRUNK_MASS).run(4.0)
        sunk = MM * np.abs(run.error[:, 2]).max()
        rows.append(Row(f'trunk mass {100 * part:+.0f} %: height error', sunk, 'mm', 30.0))
    return rows


def mpc_rows() -> list[Row]:
    """Judge the MPC by itself: its model, its forces, and a robot that follows them alone."""
    forces = hovering.one_step(hovering.standing_inputs()).plan.forces
    hover = 100.0 * abs(forces[:, 2].sum() / hovering.WEIGHT - 1.0)
    wbc = dataclasses.replace(WholeBodyParameters(), defect_weight=1e2)
    run = ClosedLoop(walk(forward=0.4), wbc=wbc).run(6.0)
    errors = [_linearisation_error(seed) for seed in range(5)]
    height, torque = MM * np.abs(run.error[:, 2]).max(), np.abs(run.torques).max()
    return [
        Row('MPC: linearisation against differences', max(errors), '', 1e-6),
        Row('MPC: hover force against the weight', hover, '%', 1.0),
        Row('trot by planned forces alone: height error', height, 'mm', 20.0, 3.0),
        Row('trot by planned forces alone: torque', torque, 'Nm', 33.5, 20.0),
    ]


def _speed_error(name: str, steady: Recording, velocity: dict[str, float]) -> list[Row]:
    """Return the error of the mean speed; on the spot there is none to compare with."""
    reached, wanted = mean_velocity(steady)
    if 'yaw_rate' in velocity:
        reached, wanted = np.ptp(steady.yaw), np.ptp(steady.yaw_reference)
    if not velocity:
        return [Row(f'{name}: drift', MM * np.linalg.norm(reached), 'mm/s')]
    error = 100.0 * np.linalg.norm(reached - wanted) / np.linalg.norm(wanted)
    return [Row(f'{name}: mean speed error', error, '%', 3.0, 1.0)]


def _astray(run: Recording) -> float:
    """Return the largest distance from the reference in the plane [mm]."""
    return float(MM * np.hypot(*run.error[:, :2].T).max())


def _survival(name: str, run: Recording) -> list[Row]:
    tilt = np.abs(run.tilt).max()
    fell = not (tilt < 60.0 and run.com[:, 2].min() > FALLEN_HEIGHT)
    details = {'tilt_deg': float(tilt), 'position_error_mm': _astray(run)}
    return [Row(f'{name}: falls', float(fell), '', 0.0, details=details)]


def _linearisation_error(seed: int) -> float:
    """Return the largest difference of A and B from central differences."""
    rotation, eta, feet, forces = rigid.random_situation(seed)
    model = SingleRigidBody(rigid.BODY, 4).linearise(rotation, eta, feet, forces)

    def rate(change: Array) -> Array:
        pushes = forces + change[12:].reshape(4, 3)
        return derivative(rigid.BODY, rotation, eta + change[:12], feet, pushes)

    h = 1e-5
    slopes = [(rate(h * e) - rate(-h * e)) / (2.0 * h) for e in np.eye(24)]
    return float(np.abs(np.hstack((model.state, model.force)) - np.transpose(slopes)).max())


PHYSICS = {
    'accelerations': acceleration_rows,
    'stand': stand_rows,
    'trot': trot_rows,
    'push': push_rows,
    'friction': friction_rows,
    'payload': payload_rows,
    'mpc': mpc_rows,
}
"""Each measurement by its name."""
