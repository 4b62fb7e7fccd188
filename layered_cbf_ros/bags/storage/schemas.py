"""Message definitions of the recorded types, from msg_schemas/: no ROS is needed for them."""

from __future__ import annotations

import json
from dataclasses import dataclass

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.resources import find_folder


@dataclass(frozen=True, slots=True)
class MessageSchema:
    """Definition of one message type.

    Attributes:
        type_name: `package/msg/Type`.
        definition: ros2msg text, dependencies appended.
        type_hash: RIHS01 hash.
    """

    type_name: str
    definition: str
    type_hash: str


def load_schema(type_name: str) -> MessageSchema:
    """Return the schema of a recorded type.

    Raises:
        BagError: If msg_schemas has no such type.
    """
    folder = find_folder('msg_schemas')
    hashes = json.loads((folder / 'type_hashes.json').read_text())
    if type_name not in hashes:
        raise BagError(
            f"no schema of '{type_name}'; add it to scripts/generate_msg_schemas and run that"
        )
    definition = (folder / f'{type_name}.msg').read_text(encoding='utf-8')
    return MessageSchema(type_name, definition, hashes[type_name])
