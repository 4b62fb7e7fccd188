"""metadata.yaml of a rosbag2 bag, version 9."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

VERSION = 9
INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(slots=True)
class RecordedTopic:
    """One topic of a bag being written; `count` grows with each message."""

    name: str
    type_name: str
    type_hash: str
    qos_yaml: str
    count: int = 0


@dataclass(slots=True)
class TimeSpan:
    """First and last log time of a bag [ns]; both 0 while it is empty."""

    first_ns: int = 0
    last_ns: int = 0


def qos_yaml(reliability: str = 'reliable', durability: str = 'volatile', depth: int = 10) -> str:
    """Return one offered QoS profile in the form that rosbag2 stores.

    Args:
        reliability: 'reliable' or 'best_effort'.
        durability: 'volatile' or 'transient_local'.
        depth: Length of the keep-last history.
    """
    profile = {
        'history': 'keep_last',
        'depth': depth,
        'reliability': reliability,
        'durability': durability,
        'deadline': dict(INFINITE),
        'lifespan': dict(INFINITE),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(INFINITE),
        'avoid_ros_namespace_conventions': False,
    }
    return str(yaml.safe_dump([profile], sort_keys=False))


def write_metadata(
    folder: Path, file_name: str, topics: Sequence[RecordedTopic], span: TimeSpan
) -> None:
    """Write metadata.yaml, whole or not at all: a reader never sees half of it.

    Args:
        folder: The bag's folder.
        file_name: Name of its one mcap file.
        topics: The topics with their counts so far.
        span: Log times so far.
    """
    times = {
        'starting_time': {'nanoseconds_since_epoch': span.first_ns},
        'duration': {'nanoseconds': span.last_ns - span.first_ns},
        'message_count': sum(topic.count for topic in topics),
    }
    information = {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'relative_file_paths': [file_name],
        **times,
        'topics_with_message_count': [_topic_entry(topic) for topic in topics],
        'compression_format': '',
        'compression_mode': '',
        'files': [{'path': file_name, **times}],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }
    text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
    unfinished = folder / 'metadata.yaml.tmp'
    unfinished.write_text(text, encoding='utf-8')
    unfinished.replace(folder / 'metadata.yaml')


def _topic_entry(topic: RecordedTopic) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': topic.name,
            'type': topic.type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': yaml.safe_load(topic.qos_yaml),
            'type_description_hash': topic.type_hash,
        },
        'message_count': topic.count,
    }
