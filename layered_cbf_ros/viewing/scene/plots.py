"""The time plots beside the scene."""

from __future__ import annotations

import time
from collections.abc import Sequence

import viser
import viser.uplot as uplot

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.palette import ROBOTS
from layered_cbf_ros.viewing.scene.colours import css
from layered_cbf_ros.viewing.scene.curves import TITLES, Curves
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

PERIOD_S = 0.25
"""Plots are drawn anew so often [s] of wall time: they cost more than the scene."""
HEIGHT = 132
NO_POINTS = uplot.Series_Points(show=False)


class Plots:
    """One plot a figure, of the last seconds."""

    def __init__(self, gui: viser.GuiApi, robots: Sequence[str]) -> None:
        self._gui, self._robots = gui, tuple(robots)
        self._curves = Curves()
        self._handles: dict[str, viser.GuiUplotHandle] = {}
        self._labels: dict[str, tuple[str, ...]] = {}
        self._folder = gui.add_folder(None)
        self._next = 0.0

    def refill(self, snapshots: Sequence[Snapshot]) -> None:
        """Show these instants and nothing older, at once."""
        self._curves.clear()
        for snapshot in snapshots:
            self._curves.add(snapshot)
        self._next = 0.0

    def draw(self, snapshot: Snapshot) -> None:
        """Show one instant more."""
        self._curves.add(snapshot)
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + PERIOD_S
        for place, title in enumerate(TITLES):
            labels, table = self._curves.table(title)
            if len(table) < 2 or table.shape[1] < 2:
                continue
            data = tuple(row.copy() for row in table)
            if self._labels.get(title) == labels:
                self._handles[title].data = data
            else:
                self._make(place, title, labels, data)

    def _make(
        self, place: int, title: str, labels: tuple[str, ...], data: tuple[Array, ...]
    ) -> None:
        """Make a plot anew: other curves than before."""
        if title in self._handles:
            self._handles[title].remove()
        self._labels[title] = labels
        with self._folder:
            self._handles[title] = self._gui.add_uplot(
                data,
                (uplot.Series(label='t [s]'), *(self._series(label) for label in labels)),
                title=title,
                scales={'x': uplot.Scale(time=False)},
                axes=(_axis(22), _axis(42)),
                legend=uplot.Legend(show=len(labels) > 1 and place == 0),
                height=HEIGHT
                + (22 * (1 + len(labels) // 3) if place == 0 and len(labels) > 1 else 0),
                padding=(4, 10, 0, 0),
                order=float(place),
            )

    def _series(self, label: str) -> uplot.Series:
        """Return the look of a curve: that of the robot, if it is one's."""
        if label in self._robots:
            colour = ROBOTS[self._robots.index(label) % len(ROBOTS)]
        else:
            known = sorted({name for names in self._labels.values() for name in names} | {label})
            colour = ROBOTS[known.index(label) % len(ROBOTS)]
        return uplot.Series(label=label, stroke=css(colour), width=1.6, points=NO_POINTS)


def _axis(size: int) -> uplot.Axis:
    return uplot.Axis(
        size=size,
        font='10px sans-serif',
        stroke='#5b6470',
        grid=uplot.Axis_Grid(stroke='#eceff3', width=1),
        ticks=uplot.Axis_Ticks(show=False),
    )
