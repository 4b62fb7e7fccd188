"""Slower messages, for people and tools, as objects of the interface packages."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Pose, PoseArray
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from layered_cbf_ros.interfaces import JOINT_NAMES, NS_PER_S, Array, RobotState, Track
from layered_cbf_ros.messages.robot_state import FOOT_NAMES
from layered_cbf_ros.messages.tracks import PLANE

WORLD = 'world'


def time_of(stamp_ns: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return Time(sec=seconds, nanosec=nanoseconds)


def header(stamp_ns: int, frame_id: str = WORLD) -> Header:
    """Return a header."""
    return Header(stamp=time_of(stamp_ns), frame_id=frame_id)


def clock(stamp_ns: int) -> Clock:
    """Return the simulated time."""
    return Clock(clock=time_of(stamp_ns))


def named_values(
    stamp_ns: int,
    names: Sequence[str],
    position: Array | None = None,
    velocity: Array | None = None,
    effort: Array | None = None,
) -> JointState:
    """Return named values as a JointState; what is not given is zero.

    All three sequences are filled: behind an empty one rclpy leaves garbage that
    strict readers refuse.
    """
    zeros = np.zeros(len(names))
    fields = [zeros if values is None else values for values in (position, velocity, effort)]
    position_, velocity_, effort_ = (array('d', np.asarray(values).tolist()) for values in fields)
    return JointState(
        header=header(stamp_ns),
        name=list(names),
        position=position_,
        velocity=velocity_,
        effort=effort_,
    )


def joint_states(state: RobotState) -> JointState:
    """Return a robot's joints as robot_state_publisher and RViz expect them."""
    return named_values(
        state.stamp_ns, JOINT_NAMES, state.configuration[7:], state.velocity[6:], state.torques
    )


def foot_contacts(state: RobotState) -> JointState:
    """Return the normal force on each foot, as effort [N]."""
    return named_values(state.stamp_ns, FOOT_NAMES, effort=state.foot_forces)


def odometry(robot: str, state: RobotState) -> Odometry:
    """Return a robot's base pose in the world and its twist in the base frame."""
    message = Odometry(header=header(state.stamp_ns), child_frame_id=f'{robot}/trunk')
    _set_pose(message.pose.pose, state.configuration[:7])
    twist = message.twist.twist
    twist.linear.x, twist.linear.y, twist.linear.z = state.velocity[:3].tolist()
    twist.angular.x, twist.angular.y, twist.angular.z = state.velocity[3:6].tolist()
    return message


def imu(
    robot: str, stamp_ns: int, orientation: Array, angular_velocity: Array, specific_force: Array
) -> Imu:
    """Return a trunk's inertial measurement, base frame.

    Args:
        robot: Its name.
        stamp_ns: Time [ns].
        orientation: Quaternion x, y, z, w, base to world.
        angular_velocity: [rad/s], (3,).
        specific_force: Acceleration minus gravity [m/s^2], (3,).
    """
    message = Imu(header=header(stamp_ns, f'{robot}/trunk'))
    q, w, a = message.orientation, message.angular_velocity, message.linear_acceleration
    q.x, q.y, q.z, q.w = orientation.tolist()
    w.x, w.y, w.z = angular_velocity.tolist()
    a.x, a.y, a.z = specific_force.tolist()
    return message


def points(stamp_ns: int, positions: Array) -> PoseArray:
    """Return points of the plane (n, 2) [m] as poses."""
    message = PoseArray(header=header(stamp_ns))
    for x, y in positions.tolist():
        pose = Pose()
        pose.position.x, pose.position.y = x, y
        message.poses.append(pose)
    return message


def track_odometry(track: Track) -> Odometry:
    """Return a track; child_frame_id names it, the covariance is filled."""
    message = Odometry(header=header(track.stamp_ns), child_frame_id=track.name)
    _set_pose(message.pose.pose, np.array([*track.position, 0.0, 0.0, 0.0, 0.0, 1.0]))
    message.twist.twist.linear.x, message.twist.twist.linear.y = track.velocity.tolist()
    message.pose.covariance = _covariance(track.covariance[:2, :2])
    message.twist.covariance = _covariance(track.covariance[2:, 2:])
    return message


def series(
    names: Sequence[str], stamps_ns: Sequence[int], values: Sequence[Sequence[Array]]
) -> JointTrajectory:
    """Return several ticks of named values in one message: full rate, few messages.

    Args:
        names: Name of each value.
        stamps_ns: Time of each tick; the first is the message's stamp [ns].
        values: Per tick up to four arrays, one value a name, which become positions,
            velocities, accelerations and effort; the rest is zero.
    """
    message = JointTrajectory(header=header(stamps_ns[0]), joint_names=list(names))
    zeros = np.zeros(len(names))
    for stamp_ns, arrays in zip(stamps_ns, values, strict=True):
        seconds, nanoseconds = divmod(stamp_ns - stamps_ns[0], NS_PER_S)
        filled = [array('d', entries.tolist()) for entries in (*arrays, *[zeros] * 4)[:4]]
        message.points.append(
            JointTrajectoryPoint(
                positions=filled[0],
                velocities=filled[1],
                accelerations=filled[2],
                effort=filled[3],
                time_from_start=Duration(sec=seconds, nanosec=nanoseconds),
            )
        )
    return message


def _set_pose(pose: Pose, values: Array) -> None:
    """Fill a pose from position and quaternion x, y, z, w, (7,)."""
    x, y, z, qx, qy, qz, qw = values.tolist()
    pose.position.x, pose.position.y, pose.position.z = x, y, z
    o = pose.orientation
    o.x, o.y, o.z, o.w = qx, qy, qz, qw


def _covariance(block: Array) -> Array:
    """Return a flat 6 x 6 covariance with a block for x and y."""
    full = np.zeros((6, 6))
    full[PLANE] = block
    return full.ravel()
