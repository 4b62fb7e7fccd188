"""Quality of service that a topic is sent with: what its publishers offered when recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import yaml

from layered_cbf_ros.bags.storage.metadata import INFINITE
from layered_cbf_ros.bags.storage.topic import Topic
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S

DEFAULT_DEPTH = 10
# rosbag2 wrote numbers before it wrote words
RELIABILITIES = {1: 'reliable', 2: 'best_effort'}
DURABILITIES = {1: 'transient_local', 2: 'volatile'}
LIVELINESSES = {1: 'automatic', 3: 'manual_by_topic'}
HISTORIES = {1: 'keep_last', 2: 'keep_all'}


@dataclass(frozen=True)
class OfferedQos:
    """One profile; what it does not tell is as ROS has it by default.

    Attributes:
        reliability: 'reliable' or 'best_effort'.
        durability: 'volatile' or 'transient_local'.
        depth: How many messages are kept, 0 for all.
        deadline_ns, lifespan_ns, lease_ns: Deadline, lifespan and lease of the liveliness
            [ns]; 0 for without end.
        liveliness: 'automatic' or 'manual_by_topic'.
    """

    reliability: str = 'reliable'
    durability: str = 'volatile'
    depth: int = DEFAULT_DEPTH
    deadline_ns: int = 0
    lifespan_ns: int = 0
    liveliness: str = 'automatic'
    lease_ns: int = 0


def qos_to_offer(topic: Topic) -> OfferedQos:
    """Return the profile to send a topic with.

    If its publishers differed in what matters between publisher and subscriber, it is
    the default one, as rosbag2 does it; the deepest history counts in any case.

    Raises:
        BagError: If the bag's profiles can't be read.
    """
    try:
        entries = yaml.safe_load(topic.qos) if topic.qos else []
        profiles = [_profile(entry) for entry in entries or []]
    except (yaml.YAMLError, AttributeError, TypeError, ValueError) as error:
        reason = str(error).partition('\n')[0]
        raise BagError(
            f'{topic.name}: its QoS profiles are spoilt ({reason}); leave it out '
            f'with --exclude-topics {topic.name}'
        ) from None
    if not profiles:
        return OfferedQos()
    first = profiles[0]
    alike = all(_seen_by_others(profile) == _seen_by_others(first) for profile in profiles)
    depths = [profile.depth for profile in profiles]
    # each of several publishers had a last word of its own; here one publisher has them all
    depth = 0 if 0 in depths else max(*depths, len(depths))
    return replace(first if alike else OfferedQos(), depth=depth)


def _profile(entry: Mapping[str, Any]) -> OfferedQos:
    history = _word(entry, 'history', HISTORIES, 'keep_last')
    depth = int(entry.get('depth', 0)) or DEFAULT_DEPTH
    return OfferedQos(
        _word(entry, 'reliability', RELIABILITIES, 'reliable'),
        _word(entry, 'durability', DURABILITIES, 'volatile'),
        0 if history == 'keep_all' else depth,
        _nanoseconds(entry.get('deadline')),
        _nanoseconds(entry.get('lifespan')),
        _word(entry, 'liveliness', LIVELINESSES, 'automatic'),
        _nanoseconds(entry.get('liveliness_lease_duration')),
    )


def _seen_by_others(profile: OfferedQos) -> tuple[object, ...]:
    return (
        profile.reliability,
        profile.durability,
        profile.deadline_ns,
        profile.liveliness,
        profile.lease_ns,
    )


def _word(entry: Mapping[str, Any], key: str, words: Mapping[int, str], default: str) -> str:
    """Return a policy's word, the default for one that is unknown or the system's choice."""
    value = entry.get(key, default)
    word = words.get(value, default) if isinstance(value, int) else str(value)
    return word if word in words.values() else default


def _nanoseconds(duration: Mapping[str, int] | str | None) -> int:
    """Return a duration [ns], 0 if it has no end."""
    if not isinstance(duration, Mapping):  # 'infinite', 'default', or nothing
        return 0
    seconds, nanoseconds = int(duration.get('sec', 0)), int(duration.get('nsec', 0))
    return 0 if seconds >= INFINITE['sec'] else seconds * NS_PER_S + nanoseconds
