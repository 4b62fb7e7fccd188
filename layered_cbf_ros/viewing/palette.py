"""The colours of what is drawn of a run: one a robot, and from red to green for safety."""

from __future__ import annotations

import numpy as np

Colour = tuple[int, int, int]

ROBOTS: tuple[Colour, ...] = (
    (0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233),
    (122, 81, 149), (102, 102, 102),
)  # fmt: skip
FLOOR: Colour = (238, 240, 243)
SKY: Colour = (250, 251, 253)
OBSTACLE: Colour = (158, 146, 132)
WALL: Colour = (134, 129, 124)
STOPPED: Colour = (178, 24, 43)
DESIRED: Colour = (120, 124, 130)
H_COLOURS: tuple[Colour, ...] = ((178, 24, 43), (244, 152, 40), (64, 160, 82))
H_SAFE = 1.0
"""From this barrier value on a pair is drawn as quite safe [m]."""


def robot_colour(index: int) -> Colour:
    """Return the colour of a robot, by its place in the team."""
    return ROBOTS[index % len(ROBOTS)]


def barrier_colour(h: float) -> Colour:
    """Return the colour of a barrier value: red at 0 m, below or unknown; green from H_SAFE on."""
    places = np.linspace(0.0, H_SAFE, len(H_COLOURS))
    red, green, blue = (
        round(float(np.interp(np.nan_to_num(h), places, channel)))
        for channel in zip(*H_COLOURS, strict=True)
    )
    return red, green, blue


def lighter(colour: Colour, share: float) -> Colour:
    """Return a colour mixed with a share of white."""
    red, green, blue = (round(part + (255 - part) * share) for part in colour)
    return red, green, blue
