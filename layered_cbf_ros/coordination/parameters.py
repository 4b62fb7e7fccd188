"""Parameters of the coordinator; their values live in params/coordinator.yaml."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class CoordinatorParameters:
    """What tunes the top layer. Units and meaning stand in each field."""

    alpha1: float = parameter(0.82, 'First decay rate of pair barriers.', '1/s', 0.01, 20.0)
    alpha2: float = parameter(0.3, 'Second decay rate of pair barriers.', '1/s', 0.01, 20.0)
    wall_alpha1: float = parameter(0.82, 'First decay rate of walls.', '1/s', 0.01, 20.0)
    wall_alpha2: float = parameter(0.15, 'Second decay rate of walls.', '1/s', 0.01, 20.0)
    beta: tuple[float, float] = parameter(
        (1.0, 2.0), 'Position gain [1/s^2] and velocity gain [1/s] of the desired motion.', '', 0.01
    )
    desired_speed: float = parameter(0.5, 'Largest desired speed.', 'm/s', 0.01, 3.0)
    start_ramp: float = parameter(
        1.0, 'Time over which the wishes grow to their full size at the start.', 's', 0.001, 10.0
    )
    speed_limit: float = parameter(0.6, 'Largest planned speed per world axis.', 'm/s', 0.01, 3.0)
    acceleration_limit: float = parameter(
        1.5, 'Largest planned acceleration per world axis.', 'm/s^2', 0.01, 10.0
    )
    yaw_rate_limit: float = parameter(1.0, 'Largest planned yaw rate.', 'rad/s', 0.0, 5.0)
    yaw_acceleration_limit: float = parameter(
        2.0, 'Largest change of the planned yaw rate.', 'rad/s^2', 0.01, 20.0
    )
    agent_radius: float = parameter(0.3, 'Radius of the disc around a robot.', 'm', 0.01, 2.0)
    horizon: float = parameter(1.0, 'Horizon of the reachable sets.', 's', 0.01, 5.0)
    max_obstacles: int = parameter(8, 'Tracks heeded at once; the nearest count.', '', 0, 32)
    confidence: float = parameter(
        2.0, "Standard deviations of a track that widen the obstacle's set.", '', 0.0, 10.0
    )
    obstacle_acceleration: float = parameter(
        0.3, 'Acceleration an unseen obstacle may have.', 'm/s^2', 0.0, 10.0
    )
    track_age_limit: float = parameter(2.0, 'Age after which a set stops growing.', 's', 0.0, 30.0)
    slack_weight: float = parameter(
        1000.0, 'Linear penalty of breaking a soft row.', 's^2/m', 1.0, 1e6
    )
    slack_tolerance: float = parameter(
        1e-3, 'Slack above this counts as an event.', 'm/s^2', 0.0, 1.0
    )
    brake_time: float = parameter(0.4, 'Time constant of the fallback brake.', 's', 0.01, 5.0)
    tracking_alarm: float = parameter(
        0.25, 'Distance between robot and plan that freezes the plan.', 'm', 0.01, 5.0
    )
    release_speed: float = parameter(
        0.1, 'Measured speed below which a frozen plan goes on.', 'm/s', 0.0, 1.0
    )
    longest_gap: float = parameter(
        0.01, 'Missed time over which the plan coasts at most.', 's', 0.0, 1.0
    )
    keep_right_angle: float = parameter(
        0.5, 'Clockwise turn of the wish while somebody is ahead.', 'rad', 0.0, 1.5
    )
    keep_right_range: float = parameter(
        3.0, 'Distance from which on somebody ahead counts.', 'm', 0.0, 20.0
    )
    stop_brake_time: float = parameter(
        0.2, 'Time constant of the brake of an emergency stop.', 's', 0.05, 2.0
    )
    sit_speed: float = parameter(
        0.02, 'Planned speed below which a stopped robot begins to sit down.', 'm/s', 0.001, 0.2
    )
    sit_time: float = parameter(
        2.0, 'Time to sit down after an emergency stop, and to stand up.', 's', 0.5, 10.0
    )
    sit_depth: float = parameter(
        0.2, 'How far the CoM goes down to sit; an A1 lies at 0.195.', 'm', 0.0, 0.25
    )
    input_resolution: float = parameter(1e-6, 'Inputs are rounded to this.', 'm/s^2', 1e-12, 1e-2)
    solver_accuracy: float = parameter(
        1e-6, 'Absolute accuracy and duality gap of the QP.', '', 1e-12, 1e-2
    )
    solver_iterations: int = parameter(50, 'Outer iterations at most.', '', 1, 1000)
    solver_inner_iterations: int = parameter(100, 'Inner iterations at most.', '', 1, 10000)
    residual_tolerance: float = parameter(
        1e-4, 'Residual up to which a solution is used.', 'm/s^2', 0.0, 1.0
    )
