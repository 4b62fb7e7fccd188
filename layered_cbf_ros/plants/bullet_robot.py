"""One A1 in a PyBullet world: loading, reading, torques and pushes.

PyBullet differs from the rest of this package in three ways, and all of them end
in this file: its joints come in another order, its base pose is that of the
trunk's *inertial* frame, and its base velocity is that of the trunk's centre of
mass in the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pybullet

from layered_cbf_ros.interfaces import JOINT_NAMES, LEGS, NS_PER_S, Array, RobotState
from layered_cbf_ros.robot_model import find_urdf

TRUNK = -1  # PyBullet's index of the base link
TOE_FRICTION = 1.0  # Bullet multiplies: the ground's coefficient is then the product


class BulletRobot:
    """One A1, held at a configuration until its world steps.

    Attributes:
        body: PyBullet's number of the robot.
        toes: Link index of each foot, in the order of LEGS.
        links: Index of every link, the trunk first.
        state: Measured state after the last step.
        centre, inertial_quaternion: Pose of the trunk's inertial frame, world.
    """

    def __init__(self, client: Any, configuration: Array, payload: float) -> None:
        """Load the robot.

        Args:
            client: Connection to the world.
            configuration: Base position [m], quaternion, joints [rad], (19,).
            payload: Point mass added at the trunk's centre of mass [kg].
        """
        self._client = client
        self.body: int = client.loadURDF(
            str(find_urdf()),
            flags=pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER,
        )
        names = self._index_by_name()
        self._joints = [names[name] for name in JOINT_NAMES]
        self.toes = [names[f'{leg}_toe_fixed'] for leg in LEGS]
        self.links = [TRUNK, *range(client.getNumJoints(self.body))]
        trunk = client.getDynamicsInfo(self.body, TRUNK)
        self._centre_in_base, self._inertial_to_base = np.array(trunk[3]), trunk[4]
        self._base_to_inertial = (*[-part for part in trunk[4][:3]], trunk[4][3])
        self._set_dynamics(trunk[0] + payload, trunk[2])
        self._place(configuration)
        self._origin_velocity = np.zeros(3)
        self._acceleration = np.zeros(3)
        self.state = RobotState(0, configuration, np.zeros(18), np.zeros(12), np.zeros(4))
        self.read(0, np.zeros(12), np.zeros(4))

    def read(self, stamp_ns: int, torques: Array, foot_forces: Array) -> None:
        """Measure the state anew.

        Args:
            stamp_ns: Time of the measurement [ns].
            torques: Joint torques that acted up to now [Nm], (12,).
            foot_forces: Normal force on each foot [N], (4,).
        """
        client, body = self._client, self.body
        joints = client.getJointStates(body, self._joints)
        centre, inertial_quaternion = client.getBasePositionAndOrientation(body)
        linear, angular = client.getBaseVelocity(body)
        # By hand: Bullet's multiplyTransforms works in single precision.
        quaternion = _product(inertial_quaternion, self._base_to_inertial)
        self._to_world = np.array(client.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        from_centre = -self._to_world @ self._centre_in_base
        self.centre, self.inertial_quaternion = centre, inertial_quaternion
        origin_velocity = linear + _cross(angular, from_centre)
        if stamp_ns > self.state.stamp_ns:
            dt = (stamp_ns - self.state.stamp_ns) / NS_PER_S
            self._acceleration = (origin_velocity - self._origin_velocity) / dt
        self._origin_velocity = origin_velocity
        configuration = np.array(
            [*(from_centre + centre), *quaternion, *[joint[0] for joint in joints]]
        )
        velocity = np.empty(18)
        velocity[:3] = origin_velocity @ self._to_world
        velocity[3:6] = angular @ self._to_world
        velocity[6:] = [joint[1] for joint in joints]
        self.state = RobotState(stamp_ns, configuration, velocity, torques, foot_forces)

    def specific_force(self, gravity: tuple[float, float, float]) -> Array:
        """Return what an accelerometer at the base's origin reads, base frame [m/s^2].

        R^T (a - g), where a is the mean acceleration over the last step.

        Args:
            gravity: In the world [m/s^2].
        """
        force: Array = (self._acceleration - gravity) @ self._to_world
        return force

    def apply(self, torques: Array) -> None:
        """Apply joint torques [Nm], (12,), during the next step only."""
        self._client.setJointMotorControlArray(
            self.body, self._joints, pybullet.TORQUE_CONTROL, forces=torques
        )

    def push(self, force: tuple[float, float, float]) -> None:
        """Apply a force [N] in the world at the trunk's CoM during the next step only."""
        self._client.applyExternalForce(self.body, TRUNK, force, self.centre, pybullet.WORLD_FRAME)

    def _index_by_name(self) -> dict[str, int]:
        count = self._client.getNumJoints(self.body)
        infos = [self._client.getJointInfo(self.body, index) for index in range(count)]
        return {info[1].decode(): info[0] for info in infos}

    def _set_dynamics(self, mass: float, inertia: tuple[float, float, float]) -> None:
        """Remove Bullet's damping and motors; set toe friction and the trunk's mass."""
        client, body = self._client, self.body
        for link in self.links:
            client.changeDynamics(
                body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0
            )
        for toe in self.toes:
            client.changeDynamics(body, toe, lateralFriction=TOE_FRICTION)
        # Given a mass alone, Bullet derives the inertia from the collision box.
        client.changeDynamics(body, TRUNK, mass=mass, localInertiaDiagonal=inertia)
        client.setJointMotorControlArray(
            body, self._joints, pybullet.VELOCITY_CONTROL, forces=[0.0] * len(self._joints)
        )

    def _place(self, configuration: Array) -> None:
        pose = configuration.tolist()
        to_world = np.array(self._client.getMatrixFromQuaternion(pose[3:7])).reshape(3, 3)
        centre = configuration[:3] + to_world @ self._centre_in_base
        quaternion = _product(pose[3:7], self._inertial_to_base)
        self._client.resetBasePositionAndOrientation(self.body, centre, quaternion)
        for joint, angle in zip(self._joints, pose[7:], strict=True):
            self._client.resetJointState(self.body, joint, angle)


def _product(p: Sequence[float], q: Sequence[float]) -> tuple[float, ...]:
    """Return the quaternion p q: first the rotation q, then p; x, y, z, w."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def _cross(a: Sequence[float], b: Array) -> Array:
    """Return a x b, (3,); np.cross costs ten times as much."""
    ax, ay, az = a
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
