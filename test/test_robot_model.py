"""The model against finite differences, conservation laws, its source and a second simulator."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from layered_cbf_ros import robot_model
from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.interfaces import GRAVITY, JOINT_NAMES, TOE_RADIUS
from layered_cbf_ros.plants.bullet_robot import BulletRobot
from layered_cbf_ros.robot_model import RobotModel, find_urdf

STEP = 1e-5
# Central differences of smooth motions of size one err by STEP^2 and by 1e-15 / STEP.
TOLERANCE = 1e-7


@pytest.fixture(scope='module')
def model():
    return RobotModel()


def random_state(seed):
    rng = np.random.default_rng(seed)
    configuration = rng.normal(size=19)
    configuration[3:7] /= np.linalg.norm(configuration[3:7])
    # Within the joints' limits, where Bullet would push back.
    configuration[7:] = rng.uniform(4 * [-0.8, -1.0, -2.6], 4 * [0.8, 4.0, -1.0])
    return configuration, rng.normal(size=18)


def moved(configuration, velocity, dt):
    """Move a configuration along a generalized velocity, written out with quaternions."""
    x, y, z, w = configuration[3:7]
    u = np.array([x, y, z])
    forward = velocity[:3]
    result = configuration.copy()
    result[:3] += dt * (forward + 2 * np.cross(u, np.cross(u, forward) + w * forward))
    turn = dt * velocity[3:6]
    angle = math.hypot(*turn)
    s = turn * (0.5 if angle < 1e-12 else math.sin(angle / 2) / angle)
    c = math.cos(angle / 2)
    result[3:6] = w * s + c * u + np.cross(u, s)
    result[6] = w * c - u @ s
    result[7:] += dt * velocity[6:]
    return result


def difference(value, configuration, velocity, acceleration=None):
    """Return the time derivative of value(configuration, velocity) by central difference."""
    a = np.zeros(18) if acceleration is None else acceleration
    ahead = value(moved(configuration, velocity, STEP), velocity + STEP * a)
    behind = value(moved(configuration, velocity, -STEP), velocity - STEP * a)
    return (ahead - behind) / (2 * STEP)


def read(model, name):
    def value(configuration, velocity):
        model.update(configuration, velocity)
        return getattr(model, name).copy()

    return value


@pytest.mark.parametrize('seed', range(3))
def test_com_and_toes_move_as_their_jacobians_say(model, seed):
    q, v = random_state(seed)
    com_rate = difference(read(model, 'com'), q, v)
    feet_rate = difference(read(model, 'feet'), q, v)
    model.update(q, v)
    np.testing.assert_allclose(model.com_jacobian @ v, com_rate, atol=TOLERANCE)
    np.testing.assert_allclose(model.com_velocity, com_rate, atol=TOLERANCE)
    np.testing.assert_allclose((model.feet_jacobian @ v).reshape(4, 3), feet_rate, atol=TOLERANCE)


@pytest.mark.parametrize('seed', range(3))
def test_feet_bias_is_the_toes_acceleration_at_constant_velocity(model, seed):
    q, v = random_state(seed)

    def toe_velocity(configuration, velocity):
        model.update(configuration, velocity)
        return model.feet_jacobian @ velocity

    rate = difference(toe_velocity, q, v)
    model.update(q, v)
    np.testing.assert_allclose(model.feet_bias.ravel(), rate, atol=10 * TOLERANCE)


@pytest.mark.parametrize('seed', range(3))
def test_a_free_robot_keeps_its_energy_and_falls_with_gravity(model, seed):
    q, v = random_state(seed)

    def energy(configuration, velocity):
        model.update(configuration, velocity)
        kinetic = 0.5 * velocity @ model.mass_matrix @ velocity
        return kinetic + model.mass * GRAVITY * model.com[2]

    model.update(q, v)
    acceleration = -np.linalg.solve(model.mass_matrix, model.bias)
    np.testing.assert_allclose(
        model.inverse_mass_matrix @ model.mass_matrix, np.eye(18), atol=1e-10
    )
    # A power balance of terms up to 1 kW cancels: 1e-9 of that, and the difference's error.
    assert abs(difference(energy, q, v, acceleration)) < 1e-4
    falling = difference(read(model, 'com_velocity'), q, v, acceleration)
    np.testing.assert_allclose(falling, [0.0, 0.0, -GRAVITY], atol=1e-5)


def test_update_kinematics_agrees_with_update(model):
    q, v = random_state(7)
    names = ('com', 'com_velocity', 'feet', 'rotation')
    model.update(q, v)
    full = [getattr(model, name).copy() for name in names]
    model.update(*random_state(8))
    model.update_kinematics(q, v)
    for name, value in zip(names, full, strict=True):
        np.testing.assert_allclose(getattr(model, name), value, atol=1e-14)


@pytest.mark.parametrize(('yaw', 'height'), [(0.0, 0.26), (2.5, 0.22), (-1.0, 0.3)])
def test_the_nominal_pose_stands_on_the_ground(model, yaw, height):
    q = model.nominal_configuration(np.array([1.0, -2.0]), yaw, height)
    model.update_kinematics(q, np.zeros(18))
    np.testing.assert_allclose(model.feet[:, 2], TOE_RADIUS, atol=1e-12)
    np.testing.assert_allclose(model.com, [1.0, -2.0, height], atol=1e-12)
    heading = [math.cos(yaw), math.sin(yaw), 0.0]
    np.testing.assert_allclose(model.rotation[:, 0], heading, atol=1e-12)
    front, left = model.feet[0] - model.feet[2], model.feet[0] - model.feet[1]
    assert front @ model.rotation[:, 0] > 0.3
    assert left @ model.rotation[:, 1] > 0.2


def test_heights_out_of_reach_are_refused(model):
    with pytest.raises(ParameterError, match=r'com_height is 0\.5'):
        model.nominal_configuration(np.zeros(2), 0.0, 0.5)


def test_mass_is_the_sum_of_the_descriptions_links(model):
    masses = ET.parse(find_urdf()).getroot().iterfind('link/inertial/mass')
    assert model.mass == pytest.approx(sum(float(m.get('value')) for m in masses), abs=1e-12)
    assert model.mass == pytest.approx(12.45, abs=0.01)  # paper section V


def test_composite_inertia_gives_the_energy_of_a_spinning_robot(model):
    """Turning as one body about a resting CoM, the robot has the energy w^T I w / 2."""
    model.update(model.nominal_configuration(np.zeros(2), 0.0), np.zeros(18))
    spin = np.array([1.0, -2.0, 3.0])
    base = model.nominal_configuration(np.zeros(2), 0.0)[:3]
    to_com = model.com - base
    twist = np.concatenate((-np.cross(spin, to_com), spin, np.zeros(12)))
    energy = 0.5 * twist @ model.mass_matrix @ twist
    assert energy == pytest.approx(0.5 * spin @ model.inertia @ spin, rel=1e-12)


def test_hip_offsets_are_the_nominal_toes_seen_from_the_com(model):
    model.update_kinematics(model.nominal_configuration(np.zeros(2), 0.0), np.zeros(18))
    np.testing.assert_allclose(model.hip_offsets, model.feet - model.com, atol=1e-12)


def test_a_missing_description_is_named(monkeypatch):
    monkeypatch.setattr(robot_model.importlib.util, 'find_spec', lambda name: None)
    with pytest.raises(ParameterError, match='install pybullet'):
        RobotModel()


@pytest.mark.parametrize('seed', range(10))
def test_bullet_and_pinocchio_accelerate_alike(model, seed):
    """Two simulators, one description: the same acceleration from the same torques.

    Bullet changes velocities by dt q''(q, q'), so one step in the air tells q''.
    """
    rng = np.random.default_rng(seed)
    q, v = random_state(seed)
    torques = rng.normal(size=12) * 5.0
    model.update(q, v)
    effort = np.concatenate((np.zeros(6), torques))
    expected = np.linalg.solve(model.mass_matrix, effort - model.bias)
    found = bullet_acceleration(q, v, torques, model.rotation.copy())
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, atol=1e-5 * scale)


def test_the_contact_points_move_as_bullets_toes_turn(model):
    """The lowest point of a toe sphere moves by v + w x (-radius e_z)."""
    q, v = random_state(3)
    model.update(q, v)
    client, robot, _ = bullet_robot(q, v, model.rotation.copy())
    links = client.getLinkStates(robot.body, robot.toes, 1, 1)
    client.disconnect()
    down = np.array([0.0, 0.0, -TOE_RADIUS])
    expected = [np.array(link[6]) + np.cross(link[7], down) for link in links]
    found = (model.contact_jacobian @ v).reshape(4, 3)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_contact_bias_is_the_contact_points_acceleration_at_constant_velocity(model):
    q, v = random_state(4)

    def contact_velocity(configuration, velocity):
        model.update(configuration, velocity)
        return model.contact_jacobian @ velocity

    rate = difference(contact_velocity, q, v)
    model.update(q, v)
    np.testing.assert_allclose(model.contact_bias.ravel(), rate, atol=10 * TOLERANCE)


def bullet_robot(q, v, rotation):
    """Return Bullet's client, robot and joints, put into a state of pinocchio's."""
    client = BulletClient(pybullet.DIRECT)
    client.setGravity(0.0, 0.0, -GRAVITY)
    robot = BulletRobot(client, q, payload=0.0)
    linear, angular = rotation @ v[:3], rotation @ v[3:6]
    at_centre = linear + np.cross(angular, np.array(robot.centre) - q[:3])
    client.resetBaseVelocity(robot.body, at_centre, angular)
    infos = [client.getJointInfo(robot.body, i) for i in range(client.getNumJoints(robot.body))]
    by_name = {info[1].decode(): info[0] for info in infos}
    joints = [by_name[name] for name in JOINT_NAMES]
    for joint, angle, speed in zip(joints, q[7:], v[6:], strict=True):
        client.resetJointState(robot.body, joint, angle, speed)
    return client, robot, joints


def bullet_acceleration(q, v, torques, rotation):
    """Return q'' by one short step of Bullet, as pinocchio counts it, (18,)."""
    dt = 1e-6
    client, robot, joints = bullet_robot(q, v, rotation)
    client.setTimeStep(dt)
    before, angular = (np.array(part) for part in client.getBaseVelocity(robot.body))
    lever = np.array(robot.centre) - q[:3]
    robot.apply(torques)
    client.stepSimulation()
    after, turning = (np.array(part) for part in client.getBaseVelocity(robot.body))
    speeds = np.array([state[1] for state in client.getJointStates(robot.body, joints)])
    client.disconnect()
    alpha = (turning - angular) / dt
    at_centre = (after - before) / dt
    at_origin = at_centre - np.cross(alpha, lever) - np.cross(angular, np.cross(angular, lever))
    base = rotation.T @ at_origin - np.cross(v[3:6], v[:3])
    return np.concatenate((base, rotation.T @ alpha, (speeds - v[6:]) / dt))
