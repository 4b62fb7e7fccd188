"""From the name of a message type to its class."""

from __future__ import annotations

import importlib

from layered_cbf_ros.errors import BagError


def message_class(name: str) -> type:
    """Return the class of a type named `package/msg/Type`, or `package/srv/Type_Event`.

    Raises:
        BagError: If its package isn't installed.
    """
    package, _, rest = name.partition('/')
    kind, _, type_name = rest.partition('/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.{kind}'), type_name)
    except (ImportError, AttributeError, ValueError):
        raise BagError(
            f"type '{name}' is not installed; install the package {package or name}"
        ) from None
    return found
