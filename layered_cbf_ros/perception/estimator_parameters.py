"""Parameters of the state estimator; values in params/state_estimator.yaml."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter

SCHEDULE, FORCE, BOTH = 'schedule', 'force', 'both'
"""What tells that a foot carries: the gait, its sensor, or only both together."""


@dataclass(frozen=True)
class StateEstimatorParameters:
    """Where a robot begins, which feet are believed, and how good each sensor is."""

    start_x: float = parameter(0.0, 'x of the CoM where the robot first stands', 'm', -1e4, 1e4)
    start_y: float = parameter(0.0, 'y of the CoM where the robot first stands', 'm', -1e4, 1e4)
    start_yaw: float = parameter(0.0, 'heading of the robot there', 'rad', -7.0, 7.0)
    start_spread: float = parameter(
        0.03, 'standard deviation of each coordinate there', 'm', 1e-4, 10.0
    )
    start_yaw_spread: float = parameter(
        0.05, 'standard deviation of the heading there', 'rad', 1e-4, 3.2
    )
    standing_at_start: bool = parameter(
        False, 'whether it stands at the first measurement, as in simulation'
    )
    standing_height: float = parameter(
        0.22, 'a base that is higher above its feet stands', 'm', 0.1, 0.4
    )
    standing_speed: float = parameter(
        0.05, 'a base that moves faster against its feet does not stand yet', 'm/s', 0.001, 1.0
    )
    standing_time: float = parameter(
        0.3, 'it must stand so long before states are published', 's', 0.0, 10.0
    )
    contacts: str = parameter(
        BOTH, 'what tells that a foot carries', choices=(SCHEDULE, FORCE, BOTH)
    )
    contact_threshold: tuple[float, ...] = parameter(
        (15.0, 15.0, 15.0, 15.0), 'a foot that reads more than at rest carries', '', 0.1, 1000.0
    )
    foot_force_scale: float = parameter(
        1.0, "newtons per unit of the feet's sensors", 'N', 0.0, 1e3
    )
    force_smoothing: float = parameter(
        0.004, 'time over which the reading of a foot is smoothed', 's', 0.0, 0.1
    )
    tare_time: float = parameter(
        0.2, 'time over which the reading of a foot in the air is averaged', 's', 0.001, 10.0
    )
    tare_height: float = parameter(
        0.0, 'a base that is lower has its feet in the air before it first stands', 'm', 0.0, 0.3
    )
    settling_time: float = parameter(
        0.02, 'time until a foot that has touched down is believed in full', 's', 0.0, 0.2
    )
    longest_flight: float = parameter(
        0.5, 'a robot that no foot carries for longer lies still', 's', 0.05, 10.0
    )
    longest_gap: float = parameter(
        0.05, 'after a longer gap in the measurements the speed is unknown', 's', 0.005, 1.0
    )
    acceleration_noise: float = parameter(
        0.02, 'density of what the accelerometer reads too much', 'm/s^2/sqrt(Hz)', 1e-4, 10.0
    )
    bias_drift: float = parameter(
        0.01, "random walk of the accelerometer's bias", 'm/s^2/sqrt(s)', 1e-6, 1.0
    )
    first_bias: float = parameter(
        0.1, "standard deviation of the accelerometer's bias at the start", 'm/s^2', 1e-4, 5.0
    )
    foot_drift: float = parameter(
        0.001, 'random walk of a foot that stands', 'm/sqrt(s)', 1e-6, 0.1
    )
    leg_noise: float = parameter(
        0.002, 'standard deviation of a foot seen from the base', 'm', 1e-5, 0.1
    )
    leg_velocity_noise: float = parameter(
        0.1, 'standard deviation of its velocity, standing still', 'm/s', 1e-4, 10.0
    )
    ground_noise: float = parameter(
        0.005, 'standard deviation of the height of the ground', 'm', 1e-5, 0.1
    )
    tilt_noise: float = parameter(
        0.005, "deviation of the IMU's roll and pitch, told in odometry only", 'rad', 0.0, 1.0
    )
    gyro_noise: float = parameter(
        0.01, 'deviation of the turning rates, told in odometry only', 'rad/s', 0.0, 1.0
    )
    external_pose: bool = parameter(True, 'whether poses of motion capture are heard')
    external_frame: str = parameter('world', 'frame in which these poses must be')
    external_noise: float = parameter(
        0.003, 'standard deviation of each coordinate of such a pose', 'm', 1e-5, 1.0
    )
    external_yaw_noise: float = parameter(
        0.01, 'standard deviation of its heading', 'rad', 1e-4, 1.0
    )
    external_delay: float = parameter(0.2, 'greatest age of such a pose', 's', 0.0, 1.0)
    external_gate: float = parameter(
        4.0, 'a pose that is farther off, in standard deviations, is an outlier', '', 1.0, 100.0
    )
    external_relock: int = parameter(
        20, 'so many outliers in a row that agree with each other are believed', '', 2, 1000
    )
    external_step: float = parameter(
        0.002, 'largest correction of the position by one pose', 'm', 1e-5, 1.0
    )
    external_turn: float = parameter(
        0.005, 'largest correction of the heading by one pose', 'rad', 1e-5, 1.0
    )
    yaw_drift: float = parameter(0.001, "random walk of the IMU's heading", 'rad/sqrt(s)', 0.0, 0.1)
