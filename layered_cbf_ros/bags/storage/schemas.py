"""Message definitions of recorded types: from msg_schemas/, so that no ROS is needed for them."""

from __future__ import annotations

import json

from layered_cbf_ros.bags.storage.definitions import MessageSchema, installed_schema
from layered_cbf_ros.resources import find_folder


def load_schema(type_name: str) -> MessageSchema:
    """Return the schema of a type: the one in msg_schemas, or else the installed one.

    Raises:
        BagError: If neither is there.
    """
    folder = find_folder('msg_schemas')
    hashes = json.loads((folder / 'type_hashes.json').read_text())
    if type_name not in hashes:
        return installed_schema(type_name)
    definition = (folder / f'{type_name}.msg').read_text(encoding='utf-8')
    return MessageSchema(type_name, definition, hashes[type_name])
