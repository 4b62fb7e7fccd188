"""Colours of the 3D page: those of the renderer, and of what only the page shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.palette import H_COLOURS, H_SAFE, Colour, lighter

Colours = NDArray[np.uint8]

LEGS: Colour = (58, 64, 72)
FEET: Colour = (24, 26, 30)
OBSTACLE: Colour = (166, 124, 82)
OBSTACLE_ARROW: Colour = (120, 78, 36)
WALL: Colour = (128, 142, 164)
FORCE: Colour = (226, 74, 51)
GROUND: Colour = (247, 248, 250)


def safety_colours(h: Array) -> Colours:
    """Return a colour for each h [m], (n,): red up to 0, green from H_SAFE on; (n, 3)."""
    places = np.linspace(0.0, H_SAFE, len(H_COLOURS))
    channels = np.array(H_COLOURS, dtype=float).T
    values = [np.interp(np.nan_to_num(h), places, channel) for channel in channels]
    return np.column_stack(values).round().astype(np.uint8)


def faded(colour: Colour, count: int, most: float = 0.85) -> Colours:
    """Return a colour `count` times, from a pale one to itself; (count, 3)."""
    shades = [lighter(colour, most * (1.0 - k / max(count - 1, 1))) for k in range(count)]
    return np.array(shades, dtype=np.uint8).reshape(count, 3)


def css(colour: Colour) -> str:
    """Return a colour as a web page writes it."""
    return '#{:02x}{:02x}{:02x}'.format(*colour)
