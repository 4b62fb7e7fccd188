"""Parameters of a fleet with its own locomotion; values live in params/coordinator.yaml."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class FleetParameters:
    """How bases are heard and told their safe velocities."""

    world_frame: str = parameter('world', 'Frame of odometry that all bases share.')
    odometry_age_limit: float = parameter(
        0.2, 'Age from which on a base counts as unknown in real time.', 's', 0.01, 2.0
    )
    position_gain: float = parameter(
        2.0, 'Velocity per distance of a base from its plan.', '1/s', 0.0, 10.0
    )
    yaw_gain: float = parameter(2.0, 'Yaw rate per heading error.', '1/s', 0.0, 10.0)
    velocity_lead: float = parameter(
        0.1, 'How far ahead in time a base is told its planned velocity: its lag.', 's', 0.0, 1.0
    )
    unicycle_ahead: float = parameter(
        0.15, "How far the centre of a unicycle's disc is ahead of its axle.", 'm', 0.01, 1.0
    )
