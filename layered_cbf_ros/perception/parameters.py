"""Parameters of the obstacle tracker."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class ObstacleTrackerParameters:
    """How obstacles move, how they are seen, and when one is believed."""

    acceleration: float = parameter(
        0.2, 'White acceleration: deviation of the velocity after one second', 'm/s', 1e-3, 50.0
    )
    noise: float = parameter(0.01, 'Standard deviation of a detected coordinate', 'm', 1e-4, 1.0)
    initial_speed: float = parameter(
        1.0, 'Standard deviation of the velocity of a new object', 'm/s', 0.01, 20.0
    )
    gate: float = parameter(
        6.0, 'Largest distance of a detection from its track, in standard deviations', '', 1.0, 20.0
    )
    birth_hits: int = parameter(3, 'Detections that make an object a track', '', 1, 100)
    birth_window: int = parameter(
        5, 'Detection messages within which it must have them', '', 1, 100
    )
    death_time: float = parameter(
        3.0,
        'Time after which an unseen track is forgotten; stamps that jump farther are not trusted',
        's',
        0.01,
        60.0,
    )
    late_window: float = parameter(
        0.2, 'Detections this much late still count, older ones are rejected', 's', 0.0, 2.0
    )
