"""What a node says when it is asked for help."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable

from layered_cbf_ros.node_parameters import NODE_PARAMETERS


def help_text(node_class: Callable[[], object]) -> str:
    """Return a node's purpose, usage and parameters, as text for a terminal."""
    purpose = (sys.modules[node_class.__module__].__doc__ or '').strip()
    name = node_class.__module__.rpartition('.')[2]
    lines = [purpose, '', f'usage: {name} --ros-args [-r __ns:=/ROBOT] [-p NAME:=VALUE] ...', '']
    for cls in NODE_PARAMETERS.get(name, ()):
        for field in dataclasses.fields(cls):
            unit = f' [{field.metadata["unit"]}]' if field.metadata['unit'] else ''
            lines.append(f'  {field.name}: {field.metadata["description"]}{unit} = {field.default}')
    return '\n'.join(lines)
