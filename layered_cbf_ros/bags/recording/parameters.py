"""Parameters of the recorder."""

from __future__ import annotations

import re
from dataclasses import dataclass

from layered_cbf_ros.bags.storage.presets import CHUNK_BYTES, PRESETS, Storage
from layered_cbf_ros.bags.topic_selection import TopicSelection, full_name
from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.parameters import parameter

SMALLEST_FILE = 65536
LARGEST_FILE = 1 << 50
LONGEST_FILE = 1e7


@dataclass(frozen=True)
class RecorderParameters:
    """What is recorded, where to, and how it is stored."""

    output: str = parameter(
        '', 'Folder of the bag; by default rosbag2_ with date and time, in the working folder'
    )
    topics: str = parameter(
        '', 'Topics to record, separated by spaces; without these and a regex, all'
    )
    regex: str = parameter('', 'Topics to record: those in which this regular expression is found')
    exclude_topics: str = parameter('', 'Topics to leave out, separated by spaces')
    exclude_regex: str = parameter('', 'Topics to leave out: those in which it is found')
    storage_preset: str = parameter(
        'lz4', 'Compression of the bag, called as in rosbag2 but for lz4', choices=tuple(PRESETS)
    )
    chunk_size: int = parameter(
        CHUNK_BYTES, 'Size of a chunk; a kill loses at most one', 'bytes', 4096, 1 << 28
    )
    max_bag_size: int = parameter(
        0, 'Size at which the next file begins, 0 for never', 'bytes', 0, LARGEST_FILE
    )
    max_bag_duration: float = parameter(
        0.0, 'Time after which the next file begins, 0 for never', 's', 0.0, LONGEST_FILE
    )
    force: bool = parameter(False, 'Replace the bag that is in the output folder')

    def __post_init__(self) -> None:
        """Check what the range of one parameter can't say."""
        for name in ('regex', 'exclude_regex'):
            value = getattr(self, name)
            try:
                re.compile(value)
            except re.error as error:
                raise ParameterError(
                    f"RecorderParameters.{name} is '{value}': {error}; "
                    'give a regular expression of Python'
                ) from None
        if 0 < self.max_bag_size < SMALLEST_FILE:
            raise ParameterError(
                f'RecorderParameters.max_bag_size is {self.max_bag_size}; '
                f'give 0 or at least {SMALLEST_FILE} bytes'
            )

    @property
    def selection(self) -> TopicSelection:
        """Return which topics are recorded."""
        return TopicSelection(
            frozenset(map(full_name, self.topics.split())),
            self.regex,
            frozenset(map(full_name, self.exclude_topics.split())),
            self.exclude_regex,
        )

    @property
    def storage(self) -> Storage:
        """Return how the bag is stored."""
        return Storage(
            self.storage_preset,
            self.chunk_size,
            self.max_bag_size,
            self.max_bag_duration,
            self.force,
        )
