"""A topic of a bag, and one message of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic found in a bag, with what the bag tells of it.

    Attributes:
        name: Full name.
        type_name: `package/msg/Type`.
        definition: Text of the type's definition, '' if the bag holds none.
        definition_format: 'ros2msg', 'ros2idl', or '' with no definition.
        type_hash: RIHS01 hash of the type, '' if the bag holds none.
        qos: Offered QoS profiles, a YAML list as rosbag2 stores it.
    """

    name: str
    type_name: str
    definition: str
    definition_format: str = 'ros2msg'
    type_hash: str = ''
    qos: str = ''


@dataclass(frozen=True, slots=True)
class Record:
    """One message as it stands in the bag.

    Attributes:
        topic: Where it was sent.
        log_time_ns, publish_time_ns: When it was recorded and sent [ns].
        data: CDR bytes.
        sequence: The publisher's count, 0 if the bag doesn't tell.
    """

    topic: Topic
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    sequence: int = 0
