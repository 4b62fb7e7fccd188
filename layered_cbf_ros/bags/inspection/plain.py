"""Messages as plain values: dictionaries, lists, numbers and texts."""

from __future__ import annotations

import dataclasses
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
