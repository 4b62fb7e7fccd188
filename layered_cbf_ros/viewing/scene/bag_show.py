"""A bag in the page, from its first instant to whatever people want to see of it."""

from __future__ import annotations

from collections.abc import Callable

import viser

from layered_cbf_ros.viewing.scene.curves import WINDOW_S
from layered_cbf_ros.viewing.scene.pace import Pace
from layered_cbf_ros.viewing.scene.playback_controls import PlaybackControls
from layered_cbf_ros.viewing.scene.view import View
from layered_cbf_ros.viewing.sight.bag_sight import BagSight
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

BEFORE_S = 0.1
"""Step at which the time before a jump's target is looked at, for curves and trails [s]."""


class BagShow:
    """Shows one bag.

    Attributes:
        snapshot: What is shown.
    """

    def __init__(self, server: viser.ViserServer, sight: BagSight) -> None:
        self._sight = sight
        self._view = View(server)
        self._view.open(sight.scenario)
        self._controls = PlaybackControls(server.gui, sight)
        self.snapshot = sight.at(0.0)

    def run(self, is_stopped: Callable[[], bool]) -> None:
        """Show what people want until told to stop."""
        pace = Pace()
        while not is_stopped():
            self.draw(pace.wait())

    def draw(self, elapsed: float) -> None:
        """Show what is wanted after some wall time [s]."""
        wanted = self._controls.advance(elapsed)
        snapshot = self._sight.at(wanted.seconds)
        if snapshot.stamp_ns == self.snapshot.stamp_ns and not wanted.is_jump:
            return
        self.snapshot = snapshot
        self._view.show(snapshot, self._before(wanted.seconds) if wanted.is_jump else ())

    def _before(self, seconds: float) -> list[Snapshot]:
        """Return the instants before a time, the oldest first."""
        count = round(min(WINDOW_S, seconds) / BEFORE_S)
        return [self._sight.at(seconds - k * BEFORE_S) for k in range(count, 0, -1)]
