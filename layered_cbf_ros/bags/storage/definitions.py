"""Message definitions made from the interface packages that are installed here.

Needs nothing but the standard library, so that a script can use it anywhere.
"""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.errors import BagError

DELIMITER = '=' * 80
NUMBERS = tuple(f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64))
PRIMITIVES = (*NUMBERS, 'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring')
FIELD_TYPE = re.compile(r'^\s*([A-Za-z][\w/]*)')


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


def installed_schema(type_name: str) -> MessageSchema:
    """Return the schema of a type of an installed interface package.

    Args:
        type_name: `package/msg/Type`.

    Raises:
        BagError: If it isn't installed.
    """
    return MessageSchema(type_name, _complete_definition(type_name), _type_hash(type_name))


def _complete_definition(type_name: str) -> str:
    """Return a definition followed by all it depends on, each once, depth first.

    This is the form that rosbag2 writes: each dependency stands below a line of 80 `=`
    and its name.
    """
    text = ''
    seen = {type_name}
    waiting = [type_name]
    while waiting:
        current = waiting.pop()
        definition = _read(current, 'msg').rstrip('\n') + '\n'
        package, _, name = current.split('/')
        text += f'{DELIMITER}\nMSG: {package}/{name}\n{definition}' if text else definition
        new = [used for used in _dependencies(current, definition) if used not in seen]
        seen.update(new)
        waiting.extend(reversed(new))
    return text


def _type_hash(type_name: str) -> str:
    """Return the RIHS01 hash that the package's generator computed."""
    description = json.loads(_read(type_name, 'json'))
    hashes = {entry['type_name']: entry['hash_string'] for entry in description['type_hashes']}
    return str(hashes[type_name])


def _read(type_name: str, suffix: str) -> str:
    """Return the text of a file that a type's package has installed."""
    package, kind, name = type_name.split('/')
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    for prefix in (*prefixes, sys.prefix):
        path = Path(prefix) / 'share' / package / kind / f'{name}.{suffix}'
        if path.is_file():
            return path.read_text(encoding='utf-8')
    raise BagError(f"no definition of '{type_name}' found; install package {package} or source ROS")


def _dependencies(type_name: str, definition: str) -> list[str]:
    """Return the message types that a definition uses directly, sorted."""
    package = type_name.split('/')[0]
    found = set()
    for line in definition.splitlines():
        match = FIELD_TYPE.match(line.split('#')[0])
        if match is None or match[1] in PRIMITIVES:
            continue
        parts = match[1].split('/')
        owner = parts[0] if len(parts) > 1 else package
        found.add(f'{owner}/msg/{parts[-1]}')
    return sorted(found)
