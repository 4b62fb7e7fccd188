"""Where a robot is and how it moves, from its sensors alone.

Orientation comes from the IMU, turned to the heading at which the robot began. Position
and velocity are those of a Kalman filter whose anchors are the feet that stand. Nothing
is told before the robot stands for the first time: the layers begin with such a robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from layered_cbf_ros.interfaces import (
    NS_PER_S,
    TOE_RADIUS,
    Array,
    GroundForcePlan,
    Measured,
    RobotState,
)
from layered_cbf_ros.perception.contact_aided_filter import (
    POSITION,
    VELOCITY,
    Belief,
    ContactAidedFilter,
)
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.external_pose import ExternalPose, ExternalPoses, PoseMemory
from layered_cbf_ros.perception.foot_contacts import ContactMemory, FootContacts
from layered_cbf_ros.perception.leg_odometry import LegMotion, LegOdometry
from layered_cbf_ros.perception.orientation import matrix, turned
from layered_cbf_ros.robot_model import yaw_of


@dataclass(frozen=True, slots=True)
class EstimatorMemory:
    """What one tick hands to the next.

    Attributes:
        stamp_ns: Of the last measurement [ns].
        contacts: Of the feet.
        poses: Of the heading, and of what was seen from outside.
        belief: Of the filter, None before the robot has stood.
        standing: For how long it has stood, before it is believed [s].
        waits_for: What was missing to that, '' if nothing is.
        flying: For how long no foot has carried [s].
        seen: Where it was seen from outside before it has stood, None if it was not.
    """

    stamp_ns: int
    contacts: ContactMemory
    poses: PoseMemory
    belief: Belief | None = None
    standing: float = 0.0
    waits_for: str = ''
    flying: float = 0.0
    seen: ExternalPose | None = None


@dataclass(frozen=True, slots=True)
class Estimate:
    """What one tick found.

    Attributes:
        memory: For the next tick.
        state: The robot's, None before it has stood.
        trust: How much each foot is believed to stand, from 0 to 1, (4,).
        refused: Why poses from outside were refused, one line each.
    """

    memory: EstimatorMemory
    state: RobotState | None
    trust: Array
    refused: tuple[str, ...] = ()


class StateEstimator:
    """Contact-aided Kalman filter of one robot, and what it needs around it.

    Its only memory is the workspace of the kinematics; all else is handed in and out.
    """

    def __init__(self, parameters: StateEstimatorParameters) -> None:
        """Put the parts together."""
        self._parameters = parameters
        self._legs = LegOdometry()
        self._contacts = FootContacts(parameters)
        self._filter = ContactAidedFilter(parameters)
        self._poses = ExternalPoses(parameters, self._filter)

    def step(
        self,
        memory: EstimatorMemory | None,
        measured: Measured,
        plan: GroundForcePlan | None,
        poses: Sequence[ExternalPose] = (),
    ) -> Estimate:
        """Return the state at the stamp of a measurement.

        Args:
            memory: From the last tick; None at the first.
            measured: What the sensors read, later than the last time.
            plan: The MPC's plan, which tells the gait, a little older; None if it is silent.
            poses: What has arrived from outside since the last tick.
        """
        memory, refused = self._look_outside(memory or self._begin(measured), poses)
        p, dt = self._parameters, (measured.stamp_ns - memory.stamp_ns) / NS_PER_S
        imu_yaw = yaw_of(matrix(measured.orientation))
        outside = self._aligned(memory, imu_yaw)
        orientation = turned(measured.orientation, outside.yaw_offset)
        legs = self._legs.look(measured, orientation, measured.angular_velocity)
        lying = memory.belief is None and legs.height + TOE_RADIUS < p.tare_height
        contacts, trust = self._contacts.step(memory.contacts, dt, measured, plan, lying)
        flying = 0.0 if trust.any() else memory.flying + dt
        if memory.belief is None:
            memory = self._wait(memory, contacts, legs, dt)
            belief = self._first(memory, measured, orientation, legs)
        else:
            force, rotation = measured.specific_force, matrix(orientation)
            belief = self._filter.predict(memory.belief, dt, rotation, force, legs, trust)
            belief = self._filter.correct(belief, legs, trust, flying > p.longest_flight)
        state = None
        if belief is not None:
            place = belief.mean[POSITION, :2]
            outside = self._poses.remember(outside, measured.stamp_ns, dt, place, imu_yaw)
            state = self._state(belief, contacts, measured, orientation)
        memory = replace(
            memory,
            stamp_ns=measured.stamp_ns,
            contacts=contacts,
            poses=outside,
            belief=belief,
            flying=flying,
        )
        return Estimate(memory, state, trust, refused)

    def variances(self, belief: Belief, yaw_variance: float) -> tuple[Array, Array]:
        """Return how uncertain pose and twist are.

        Args:
            belief: Of the filter.
            yaw_variance: Of the heading [rad^2].

        Returns:
            Variances of position [m^2] and of roll, pitch and yaw [rad^2], (6,), and of
            linear [m^2/s^2] and angular velocity [rad^2/s^2], (6,).
        """
        p = self._parameters
        plane, vertical = np.diagonal(belief.covariance, axis1=1, axis2=2)
        tilt, turning = p.tilt_noise**2, p.gyro_noise**2
        place = (plane[POSITION], plane[POSITION], vertical[POSITION])
        speed = (plane[VELOCITY], plane[VELOCITY], vertical[VELOCITY])
        pose = np.array((*place, tilt, tilt, yaw_variance))
        return pose, np.array((*speed, turning, turning, turning))

    def _begin(self, measured: Measured) -> EstimatorMemory:
        contacts = self._contacts.start(measured.foot_forces)
        return EstimatorMemory(measured.stamp_ns, contacts, self._poses.start(0.0, None))

    def _aligned(self, memory: EstimatorMemory, imu_yaw: float) -> PoseMemory:
        """Return what is known of the heading; before it stands, it is that of the start."""
        if memory.belief is not None:
            return memory.poses
        first = self._parameters.start_yaw if memory.seen is None else memory.seen.yaw
        return self._poses.start(first - imu_yaw, memory.seen)

    def _look_outside(
        self, memory: EstimatorMemory, poses: Sequence[ExternalPose]
    ) -> tuple[EstimatorMemory, tuple[str, ...]]:
        """Take what was seen from outside; a robot that does not stand yet only keeps the last."""
        if memory.belief is None:
            seen = poses[-1] if poses else memory.seen
            old = seen is not None and memory.stamp_ns - seen.stamp_ns > NS_PER_S
            return replace(memory, seen=None if old else seen), ()
        told, belief, refused = memory.poses, memory.belief, []
        for pose in poses:
            told, belief, why = self._poses.correct(told, belief, pose)
            refused += [why] if why else []
        return replace(memory, poses=told, belief=belief), tuple(refused)

    def _wait(
        self, memory: EstimatorMemory, contacts: ContactMemory, legs: LegMotion, dt: float
    ) -> EstimatorMemory:
        """Note for how long all feet have carried a base that is up and at rest."""
        waits_for = self._not_standing(contacts, legs)
        standing = 0.0 if waits_for else memory.standing + dt
        return replace(memory, standing=standing, waits_for=waits_for)

    def _first(
        self, memory: EstimatorMemory, measured: Measured, orientation: Array, legs: LegMotion
    ) -> Belief | None:
        """Return what is known of a robot that has stood long enough, None of another."""
        p, seen = self._parameters, memory.seen
        if not p.standing_at_start and memory.standing < p.standing_time:
            return None
        if seen is None:
            centre = self._legs.centre_of_mass(measured, orientation)[:2]
            plane, spread = np.array((p.start_x, p.start_y)) - centre, p.start_spread
        else:
            plane, spread = seen.position[:2], p.external_noise
        return self._filter.start(plane, spread, matrix(orientation), legs)

    def _not_standing(self, contacts: ContactMemory, legs: LegMotion) -> str:
        """Return what is missing for a robot to stand, '' if nothing is."""
        p, height = self._parameters, legs.height + TOE_RADIUS
        if height < p.standing_height:
            return f'base at {height:.2f} m, standing_height {p.standing_height:.2f} m'
        unloaded = self._contacts.unloaded(contacts)
        if unloaded:
            return f'a load on {unloaded}'
        return '' if legs.speed < p.standing_speed else 'rest'

    def _state(
        self, belief: Belief, contacts: ContactMemory, measured: Measured, orientation: Array
    ) -> RobotState:
        loads = self._parameters.foot_force_scale * contacts.loads
        position = belief.mean[POSITION]
        configuration = np.concatenate((position, orientation, measured.joints[0]))
        linear = belief.mean[VELOCITY] @ belief.rotation
        velocity = np.concatenate((linear, measured.angular_velocity, measured.joints[1]))
        return RobotState(measured.stamp_ns, configuration, velocity, measured.joints[2], loads)
