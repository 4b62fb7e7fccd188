"""metadata.yaml of a rosbag2 bag, version 9."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

VERSION = 9
INFINITE = {'sec': 9223372036, 'nsec': 854775807}
METADATA_FILE = 'metadata.yaml'
INFORMATION = 'rosbag2_bagfile_information'


@dataclass(slots=True)
class RecordedTopic:
    """One topic of a bag being written; `count` grows with each message.

    Attributes:
        name, type_name, type_hash, definition: As in Topic.
        qos_yaml: Offered QoS profiles, a YAML list.
        count: Messages in the bag.
    """

    name: str
    type_name: str
    type_hash: str
    qos_yaml: str
    definition: str = ''
    count: int = 0


@dataclass(frozen=True, slots=True)
class FilePart:
    """One file of a bag.

    Attributes:
        name: Its name.
        first_ns, last_ns: Log times [ns], both 0 without a message.
        count: Messages in it.
    """

    name: str
    first_ns: int = 0
    last_ns: int = 0
    count: int = 0


def qos_profile(
    reliability: str,
    durability: str,
    depth: int = 0,
    history: str = 'unknown',
    others: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return one offered QoS profile in the form that rosbag2 stores.

    Args:
        reliability: 'reliable' or 'best_effort'.
        durability: 'volatile' or 'transient_local'.
        depth: Length of the history, 0 if it isn't known: no publisher tells others.
        history: 'keep_last', 'keep_all' or 'unknown'.
        others: Deadline, lifespan and liveliness, where they aren't the usual ones.
    """
    return {
        'history': history,
        'depth': depth,
        'reliability': reliability,
        'durability': durability,
        'deadline': dict(INFINITE),
        'lifespan': dict(INFINITE),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(INFINITE),
        'avoid_ros_namespace_conventions': False,
        **(others or {}),
    }


def qos_list(profiles: Sequence[Mapping[str, Any]]) -> str:
    """Return offered QoS profiles as YAML."""
    return str(yaml.safe_dump([dict(profile) for profile in profiles], sort_keys=False))


def qos_yaml(reliability: str = 'reliable', durability: str = 'volatile', depth: int = 10) -> str:
    """Return one profile of a known depth as YAML, see `qos_profile`."""
    return qos_list([qos_profile(reliability, durability, depth, 'keep_last')])


def metadata_text(
    files: Sequence[FilePart],
    topics: Sequence[RecordedTopic],
    custom_data: Mapping[str, str] | None = None,
    kept: Mapping[str, Any] | None = None,
) -> str:
    """Return the text of metadata.yaml.

    Args:
        files: The bag's files, in order.
        topics: Its topics with their counts.
        custom_data: What else the recorder has to tell.
        kept: Entries of an older metadata.yaml that nothing else tells.
    """
    spans = [part for part in files if part.count]
    whole = FilePart(
        '',
        min((part.first_ns for part in spans), default=0),
        max((part.last_ns for part in spans), default=0),
        sum(part.count for part in spans),
    )
    information = {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'relative_file_paths': [part.name for part in files],
        **_times(whole),
        'topics_with_message_count': [_topic_entry(topic) for topic in topics],
        'compression_format': '',
        'compression_mode': '',
        'files': [{'path': part.name, **_times(part)} for part in files],
        'custom_data': dict(custom_data) if custom_data else None,
        'ros_distro': 'jazzy',
        **(kept or {}),
    }
    dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
    return str(yaml.dump({INFORMATION: information}, Dumper=dumper, sort_keys=False))


def _times(part: FilePart) -> dict[str, Any]:
    return {
        'starting_time': {'nanoseconds_since_epoch': part.first_ns},
        'duration': {'nanoseconds': part.last_ns - part.first_ns},
        'message_count': part.count,
    }


def _topic_entry(topic: RecordedTopic) -> dict[str, Any]:
    loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
    return {
        'topic_metadata': {
            'name': topic.name,
            'type': topic.type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': yaml.load(topic.qos_yaml, Loader=loader) or [],
            'type_description_hash': topic.type_hash,
        },
        'message_count': topic.count,
    }
