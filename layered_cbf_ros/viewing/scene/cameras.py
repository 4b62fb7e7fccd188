"""Where each visitor looks from: a good first view, and following a robot."""

from __future__ import annotations

import numpy as np
import viser

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

DIRECTION = np.array([-0.42, -0.78, 0.62])
"""From what is looked at to the first place of a camera."""
FIELD_OF_VIEW = 0.9
"""Vertical [rad]: less than the usual, so that bodies at the edge keep their shape."""
NEAREST, FARTHEST = 5.0, 13.0
"""Of the first place [m]."""
ROOM = 1.1
"""Distance of a camera a metre of what it has to see."""
NOBODY = 'nobody'


class Cameras:
    """Follows, for each visitor, whom he wants."""

    def __init__(self, server: viser.ViserServer, followed: viser.GuiDropdownHandle[str]) -> None:
        """Begin.

        Args:
            server: Whose visitors.
            followed: Tells the name of the robot in the middle.
        """
        self._server, self._followed = server, followed
        self._is_placed = False

    def draw(self, snapshot: Snapshot) -> None:
        """Move the cameras with the robots of an instant."""
        places = {robot.name: robot.configuration[:3] for robot in snapshot.robots}
        if not self._is_placed and places:
            self._place(np.array(list(places.values())))
        target = places.get(self._followed.value)
        if target is None:
            return
        for client in self._server.get_clients().values():
            camera = client.camera
            offset = camera.position - camera.look_at  # both of the visitor's last word
            with client.atomic():
                camera.position = target + offset
                camera.look_at = target

    def _place(self, places: Array) -> None:
        """Let new visitors see all robots."""
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        spread = float(np.hypot(*np.ptp(places[:, :2], axis=0)))
        distance = min(max(ROOM * spread, NEAREST), FARTHEST)
        towards = DIRECTION / np.linalg.norm(DIRECTION)
        self._server.initial_camera.fov = FIELD_OF_VIEW
        self._server.initial_camera.look_at = middle
        self._server.initial_camera.position = middle + distance * towards
        self._is_placed = True
