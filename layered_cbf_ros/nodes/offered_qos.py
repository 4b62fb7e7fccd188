"""Quality of service that publishers offer: what to subscribe with, and how a bag tells it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from layered_cbf_ros.bags.storage.metadata import INFINITE, qos_list, qos_profile
from layered_cbf_ros.interfaces import NS_PER_S

HISTORIES = {QoSHistoryPolicy.KEEP_LAST: 'keep_last', QoSHistoryPolicy.KEEP_ALL: 'keep_all'}


def matching(offered: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return a profile that gets everything from every publisher of a topic.

    Args:
        offered: What each publisher offers.
        depth: How many messages may wait.
    """
    reliable = all(o.reliability == QoSReliabilityPolicy.RELIABLE for o in offered)
    latched = all(o.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for o in offered)
    return QoSProfile(
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=(
            QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE
        ),
    )


def as_yaml(offered: Sequence[QoSProfile]) -> str:
    """Return what each publisher offers in the form that rosbag2 stores."""
    return qos_list([_as_dict(profile) for profile in offered])


def in_words(profile: QoSProfile) -> str:
    """Return a profile for a person."""
    return f'{_reliability(profile)}, {_durability(profile)}'


def _as_dict(profile: QoSProfile) -> dict[str, Any]:
    """Return one profile; a history that the middleware doesn't tell is unknown."""
    history = HISTORIES.get(profile.history, 'unknown')
    others = {
        'deadline': _as_time(profile.deadline),
        'lifespan': _as_time(profile.lifespan),
        'liveliness': profile.liveliness.name.lower(),
        'liveliness_lease_duration': _as_time(profile.liveliness_lease_duration),
    }
    depth = 0 if history == 'unknown' else profile.depth
    return qos_profile(_reliability(profile), _durability(profile), depth, history, others)


def _reliability(profile: QoSProfile) -> str:
    reliable = profile.reliability == QoSReliabilityPolicy.RELIABLE
    return 'reliable' if reliable else 'best_effort'


def _durability(profile: QoSProfile) -> str:
    latched = profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    return 'transient_local' if latched else 'volatile'


def _as_time(duration: Duration) -> dict[str, int]:
    """Return a duration; none at all, and one beyond what fits, mean for ever."""
    seconds, nanoseconds = divmod(duration.nanoseconds, NS_PER_S)
    if duration.nanoseconds <= 0 or seconds >= INFINITE['sec']:
        return dict(INFINITE)
    return {'sec': seconds, 'nsec': nanoseconds}
