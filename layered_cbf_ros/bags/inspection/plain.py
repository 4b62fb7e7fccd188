"""Messages as plain values: dictionaries, lists, numbers and texts."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np


def plain(message: Any) -> Any:
    """Return a message, as rosbags decodes it, as plain values; constants are left out."""
    if dataclasses.is_dataclass(message):
        return {
            field.name: plain(getattr(message, field.name))
            for field in dataclasses.fields(message)
            if not str(field.type).startswith('ClassVar')
        }
    if isinstance(message, np.ndarray | np.generic):
        return message.tolist()
    if isinstance(message, list):
        return [plain(part) for part in message]
    return message


def finite(value: Any) -> Any:
    """Return plain values as JSON takes them: a number that isn't finite becomes None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return value
