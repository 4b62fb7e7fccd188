"""Rigid-body model of the Unitree A1, as the two lower layers need it."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pinocchio as pin

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.interfaces import JOINT_NAMES, LEGS, TOE_RADIUS, Array

FALLEN_TILT = math.radians(60.0)
"""A trunk tilted beyond this angle from the vertical has fallen [rad]."""

FALLEN_HEIGHT = 0.12
"""A base below this height lies on the ground [m]."""

_UPRIGHT_TO_FOLDED = (0.05, 1.5)
"""Range of upper-leg angles in which a standing pose is looked for [rad]."""


def find_urdf() -> Path:
    """Return the A1 description that comes with the pybullet package.

    Raises:
        ParameterError: If the package, or the file in it, is absent.
    """
    spec = importlib.util.find_spec('pybullet_data')
    if spec is None or spec.origin is None:
        raise ParameterError('robot model: no package pybullet_data; install pybullet')
    path = Path(spec.origin).parent / 'a1' / 'a1.urdf'
    if not path.is_file():
        raise ParameterError(f'robot model: {path} is absent; install pybullet 3.2.7')
    return path


class RobotModel:
    """Kinematics and dynamics D(q) q'' + H(q, q') = B tau + J_c^T f, paper eq. (24).

    The attributes below are views that `update` overwrites; copy what is to be
    kept. World frame unless said otherwise; generalized velocities and forces
    have the base part first, in the base frame, then the joints.

    Attributes:
        mass: Total mass [kg].
        inertia: Rotational inertia about the CoM at the nominal pose, base
            frame [kg m^2], (3, 3).
        hip_offsets: From the CoM to each toe at the nominal pose,
            heading frame [m], (4, 3).
        com, com_velocity: CoM [m], [m/s], (3,).
        rotation: Base frame to world, (3, 3).
        feet: Centres of the toe spheres [m], (4, 3).
        mass_matrix, inverse_mass_matrix: D and its inverse, (18, 18).
        bias: Coriolis, centrifugal and gravity terms H, (18,).
        com_jacobian: Of the CoM velocity, (3, 18).
        feet_jacobian: Of the toe velocities, one after the other, (12, 18).
        feet_bias: Their acceleration at q'' = 0 [m/s^2], (4, 3).
        contact_jacobian: J_c, of the velocities of the points where toe spheres
            would touch level ground, v + w x (-radius e_z), (12, 18). They rest
            when a toe rolls without slipping, while its centre moves on.
        contact_bias: The rate of those velocities at q'' = 0 [m/s^2], (4, 3).
    """

    def __init__(self, com_height: float = 0.26) -> None:
        """Read the description.

        Args:
            com_height: CoM height of the nominal pose [m].

        Raises:
            ParameterError: If the description is absent or the height out of reach.
        """
        self._model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
        if tuple(self._model.names)[2:] != JOINT_NAMES:
            raise ParameterError(f'robot model: joints are {tuple(self._model.names)[2:]}')
        self._toes = tuple(self._model.getFrameId(f'{leg}_toe') for leg in LEGS)
        self._data = data = self._model.createData()
        self._no_acceleration = np.zeros(self._model.nv)
        self.mass = float(pin.computeTotalMass(self._model))
        self.com, self.com_velocity = data.com[0], data.vcom[0]
        self.rotation = data.oMi[1].rotation
        self.mass_matrix, self.inverse_mass_matrix = data.M, data.Minv
        self.bias, self.com_jacobian = data.nle, data.Jcom
        self.feet, self.feet_bias = np.zeros((4, 3)), np.zeros((4, 3))
        self.contact_bias = np.zeros((4, 3))
        self.feet_jacobian, self.contact_jacobian = np.zeros((12, 18)), np.zeros((12, 18))
        self._toe_jacobians, self._toe_biases = np.zeros((4, 6, 18)), np.zeros((4, 6))
        self._toe_positions = tuple(data.oMf[toe].translation for toe in self._toes)
        self._set_nominal(com_height)

    def update(self, configuration: Array, velocity: Array) -> None:
        """Compute everything for a state.

        Args:
            configuration: As in RobotState, (19,).
            velocity: As in RobotState, (18,).
        """
        model, data = self._model, self._data
        frame = pin.LOCAL_WORLD_ALIGNED
        pin.forwardKinematics(model, data, configuration, velocity, self._no_acceleration)
        for leg, toe in enumerate(self._toes):
            acceleration = pin.getFrameClassicalAcceleration(model, data, toe, frame)
            self._toe_biases[leg] = acceleration.vector
        # Overwrites the accelerations of the bodies, hence after their use.
        pin.computeAllTerms(model, data, configuration, velocity)
        pin.computeMinverse(model, data, configuration)
        for leg, toe in enumerate(self._toes):
            self._toe_jacobians[leg] = pin.getFrameJacobian(model, data, toe, frame)
        _split(self._toe_biases, self.feet_bias, self.contact_bias)
        jacobians = self.feet_jacobian.reshape(4, 3, 18), self.contact_jacobian.reshape(4, 3, 18)
        _split(self._toe_jacobians, *jacobians)
        self._place_feet()

    def update_kinematics(self, configuration: Array, velocity: Array) -> None:
        """Compute only com, com_velocity, rotation and feet.

        Args:
            configuration: As in RobotState, (19,).
            velocity: As in RobotState, (18,).
        """
        pin.centerOfMass(self._model, self._data, configuration, velocity)
        self._place_feet()

    def toe_velocities(self, configuration: Array, velocity: Array) -> tuple[Array, Array]:
        """Compute only rotation and feet, and return how the feet move.

        Args:
            configuration: As in RobotState, (19,).
            velocity: As in RobotState, (18,).

        Returns:
            Velocities of the toes' centres, and of the points where they would touch
            level ground, as with contact_jacobian, world [m/s], (4, 3) each.
        """
        pin.forwardKinematics(self._model, self._data, configuration, velocity)
        self._place_feet()
        spatial, centre, contact = np.empty((4, 6)), np.empty((4, 3)), np.empty((4, 3))
        for leg, toe in enumerate(self._toes):
            motion = pin.getFrameVelocity(self._model, self._data, toe, pin.LOCAL_WORLD_ALIGNED)
            spatial[leg] = motion.vector
        _split(spatial, centre, contact)
        return centre, contact

    def nominal_configuration(self, com_xy: Array, yaw: float, com_height: float = 0.26) -> Array:
        """Return the standing pose: level trunk, toes below the hips, on the ground.

        With upper and lower links of one length, joint angles (0, a, -2 a) put
        each toe straight below its hip. The CoM rises steadily as a falls, so a
        is found by bisection.

        Args:
            com_xy: Point that the CoM stands above [m], (2,).
            yaw: Heading [rad].
            com_height: CoM height over the ground [m].

        Returns:
            Configuration as in RobotState, (19,); toe spheres touch z = 0.

        Raises:
            ParameterError: If the legs can't reach that height.
        """
        low, high = _UPRIGHT_TO_FOLDED
        if not self._standing_height(high) < com_height < self._standing_height(low):
            raise ParameterError(f'com_height is {com_height:g}; out of reach of the legs')
        while high - low > 1e-14:
            middle = 0.5 * (low + high)
            if self._standing_height(middle) > com_height:
                low = middle
            else:
                high = middle
        return self._standing(0.5 * (low + high), com_xy, yaw)

    def _standing_height(self, upper_angle: float) -> float:
        self._standing(upper_angle, np.zeros(2), 0.0)
        return float(self.com[2])

    def _standing(self, upper_angle: float, com_xy: Array, yaw: float) -> Array:
        """Return the standing pose with a given upper-leg angle [rad]."""
        configuration = np.zeros(19)
        configuration[5:7] = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        configuration[7:] = np.tile([0.0, upper_angle, -2.0 * upper_angle], 4)
        self.update_kinematics(configuration, self._no_acceleration)
        configuration[:2] = com_xy - self.com[:2]
        configuration[2] = TOE_RADIUS - self.feet[0, 2]
        self.update_kinematics(configuration, self._no_acceleration)
        return configuration

    def _set_nominal(self, com_height: float) -> None:
        """Set what belongs to the nominal pose."""
        configuration = self.nominal_configuration(np.zeros(2), 0.0, com_height)
        pin.crba(self._model, self._data, configuration)
        self.inertia = np.array(self._data.Ycrb[1].inertia)
        self.hip_offsets = self.feet - self.com

    def _place_feet(self) -> None:
        pin.updateFramePlacements(self._model, self._data)
        for leg, position in enumerate(self._toe_positions):
            self.feet[leg] = position


def yaw_of(rotation: Array) -> float:
    """Return the heading of an orientation, base to world (3, 3) [rad]."""
    return math.atan2(rotation[1, 0], rotation[0, 0])


def has_fallen(configuration: Array) -> bool:
    """Tell whether a robot lies: tilted beyond FALLEN_TILT, or its base near the ground.

    Args:
        configuration: As in RobotState, (19,).
    """
    x, y = configuration[3:5]
    upright = 1.0 - 2.0 * (x * x + y * y)
    return bool(upright < math.cos(FALLEN_TILT) or configuration[2] < FALLEN_HEIGHT)


def _split(spatial: Array, centre: Array, contact: Array) -> None:
    """Turn rows v, w of each toe into v and v + w x (-radius e_z).

    Args:
        spatial: Linear and angular rows, (4, 6, ...).
        centre, contact: Where the results go, (4, 3, ...).
    """
    centre[:] = spatial[:, :3]
    contact[:] = centre
    contact[:, 0] -= TOE_RADIUS * spatial[:, 4]
    contact[:, 1] += TOE_RADIUS * spatial[:, 3]
