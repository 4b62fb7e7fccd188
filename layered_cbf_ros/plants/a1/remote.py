"""The robot's own remote control: forty bytes in every state."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass

from layered_cbf_ros.plants.a1.packets import REMOTE_BYTES
from layered_cbf_ros.scenario_emulation import BUTTONS

BUTTONS_AT = 2
LX_AT, LY_AT = 4, 20  # lx, rx, ry, the trigger L2, ly: five floats in this order


@dataclass(frozen=True, slots=True)
class Remote:
    """What is held.

    Attributes:
        buttons: Names of BUTTONS.
        sticks: Left x and y, right x and y, each in [-1, 1]; 0 if it told no number.
    """

    buttons: frozenset[str]
    sticks: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def pressed_buttons(data: bytes) -> frozenset[str]:
    """Return the buttons that are held."""
    bits = struct.unpack_from('<H', data, BUTTONS_AT)[0]
    return frozenset(name for k, name in enumerate(BUTTONS) if bits >> k & 1)


def read_remote(data: bytes) -> Remote:
    """Return all that is held."""
    lx, rx, ry, _, ly = struct.unpack_from('<5f', data, LX_AT)
    return Remote(pressed_buttons(data), (_stick(lx), _stick(ly), _stick(rx), _stick(ry)))


def _stick(told: float) -> float:
    return max(-1.0, min(1.0, told)) if math.isfinite(told) else 0.0


def write_remote(buttons: Iterable[str]) -> bytes:
    """Return the bytes of a remote control with some buttons held, its sticks let go."""
    bits = sum(1 << BUTTONS.index(name) for name in set(buttons))
    return struct.pack('<HH', 0, bits).ljust(REMOTE_BYTES, b'\0')
