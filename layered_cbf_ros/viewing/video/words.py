"""Words and figures in a picture: who is who, the time, the smallest h, what shapes mean."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.viewing.history import CHART_NS, History
from layered_cbf_ros.viewing.palette import (
    DESIRED,
    STOPPED,
    Colour,
    barrier_colour,
    lighter,
    robot_colour,
)
from layered_cbf_ros.viewing.sight.snapshot import RobotSight, Snapshot
from layered_cbf_ros.viewing.video.camera import NEAR, Camera
from layered_cbf_ros.viewing.video.frame import Frame

INK: Colour = (38, 42, 48)
PALE: Colour = (110, 116, 124)
PANEL = (255, 255, 255, 215)
MARGIN, LINE, PANEL_WIDTH = 14.0, 23.0, 300.0
LEAST_UNIT = 0.45  # smaller words can't be read
NAME_HEIGHT = 0.42  # of a name over the ground [m]
CHART_WIDTH, CHART_HEIGHT = 250.0, 84.0
CHART_TOP = 2.0  # h at its upper edge [m]


class Words:
    """Writes on one picture; lengths are in pixels of a picture that is 720 high."""

    def __init__(self, picture: Image.Image, camera: Camera) -> None:
        """Begin.

        Args:
            picture: What is written on.
            camera: Of the picture.
        """
        self._draw = ImageDraw.Draw(picture, 'RGBA')
        self._camera = camera
        self._unit = max(min(camera.height / 720.0, camera.width / 1280.0), LEAST_UNIT)
        self._font = ImageFont.load_default(17.0 * self._unit)
        self._large = ImageFont.load_default(24.0 * self._unit)

    def write(self, frame: Frame) -> None:
        """Write all that a frame tells."""
        snapshot = frame.snapshot
        self._names(snapshot)
        self._figures(snapshot, frame.seconds)
        if frame.history.barriers:
            self._chart(frame.history)
        self._legend(snapshot)
        if snapshot.is_stopped:
            self._banner('EMERGENCY STOP', STOPPED)
        elif snapshot.is_paused:
            self._banner('paused', PALE)

    def _names(self, snapshot: Snapshot) -> None:
        """Write each body's name above it."""
        for place, robot in enumerate(snapshot.robots):
            self._name(robot.name, robot.configuration[:2], NAME_HEIGHT, robot_colour(place))
        for thing in snapshot.obstacles:
            self._name(thing.name, thing.position, thing.height + 0.1, PALE)

    def _name(self, text: str, at: Array, height: float, colour: Colour) -> None:
        point = np.array([at[0], at[1], height])
        if float(self._camera.depth(point)) > NEAR:
            place = self._camera.project(point).tolist()
            halo = max(round(2 * self._unit), 1)
            self._draw.text(
                place, text, colour, self._font, 'ms',
                stroke_width=halo, stroke_fill=(255, 255, 255),
            )  # fmt: skip

    def _figures(self, snapshot: Snapshot, seconds: float) -> None:
        """Write time, smallest h, smallest clearance and how each robot fares."""
        lines: list[tuple[str, str, Colour | None]] = []
        pairs = [pair for pair in snapshot.barriers if math.isfinite(pair.psi0)]
        if pairs:
            pair = min(pairs, key=lambda pair: pair.psi0)
            lines.append((f'h  {pair.psi0:.2f} m', pair.label, barrier_colour(pair.psi0)))
        distances = {
            label: distance
            for label, distance in snapshot.distances.items()
            if not label.endswith('~ground') and math.isfinite(distance)
        }
        if distances:
            label = min(distances, key=lambda name: distances[name])
            lines.append((f'gap  {distances[label]:.2f} m', label, None))
        for place, robot in enumerate(snapshot.robots):
            lines.append((robot.name, _fares(robot), robot_colour(place)))
        height = MARGIN + 1.6 * LINE + len(lines) * LINE
        self._panel(MARGIN, MARGIN, PANEL_WIDTH, height)
        self._text(2.0 * MARGIN, 1.3 * MARGIN, f'{seconds:.1f} s', INK, True)
        y = MARGIN + 1.7 * LINE
        for name, figure, colour in lines:
            if colour is not None:
                self._dot(2.0 * MARGIN + 5.0, y + 0.45 * LINE, colour)
            self._text(3.2 * MARGIN, y, name, INK)
            self._text(11.5 * MARGIN, y, figure, PALE)
            y += LINE

    def _chart(self, history: History) -> None:
        """Draw the smallest h over the last seconds; a red line is where safety ends."""
        left = self._camera.width / self._unit - MARGIN - CHART_WIDTH
        self._panel(left, MARGIN, CHART_WIDTH, CHART_HEIGHT + 1.4 * LINE)
        self._text(left + 0.7 * MARGIN, 1.3 * MARGIN, 'smallest h, last 20 s', PALE)
        self._text(left + CHART_WIDTH - 42.0, 1.3 * MARGIN, f'{CHART_TOP:g} m', PALE)
        bottom = MARGIN + 1.3 * LINE + CHART_HEIGHT - 6.0
        self._line([(left + 6.0, bottom), (left + CHART_WIDTH - 6.0, bottom)], STOPPED, 1.6)
        now_ns = history.barriers[-1][0]
        span, reach = CHART_WIDTH - 12.0, CHART_HEIGHT - 10.0
        points = []
        for stamp_ns, h in history.barriers:
            x = left + 6.0 + span * (1.0 - (now_ns - stamp_ns) / CHART_NS)
            points.append((x, bottom - reach * float(np.clip(h / CHART_TOP, -0.05, 1.0))))
        self._line(points, INK, 2.2)
        self._dot(*points[-1], barrier_colour(history.barriers[-1][1]))

    def _legend(self, snapshot: Snapshot) -> None:
        """Tell what the shapes on the ground mean."""
        entries: list[tuple[str, Colour, str]] = [
            ('o', robot_colour(0), 'reachable set'),
            ('-', DESIRED, 'desired velocity'),
            ('-', robot_colour(0), 'safe velocity'),
        ]
        if snapshot.balls:
            entries.insert(1, ('o', barrier_colour(0.5), 'potential collision: red at h = 0'))
        y = self._camera.height / self._unit - MARGIN - 1.2 * LINE
        widths = [self._font.getlength(text) / self._unit + 46.0 for _, _, text in entries]
        self._panel(MARGIN, y, sum(widths) + 10.0, 1.2 * LINE)
        x = MARGIN + 10.0
        for (shape, colour, text), width in zip(entries, widths, strict=True):
            if shape == 'o':
                self._dot(x + 8.0, y + 0.6 * LINE, lighter(colour, 0.4))
            else:
                self._line([(x, y + 0.6 * LINE), (x + 18.0, y + 0.6 * LINE)], colour, 4.0)
            self._text(x + 25.0, y + 0.12 * LINE, text, INK)
            x += width

    def _banner(self, text: str, colour: Colour) -> None:
        """Write across the top what everybody must know."""
        middle = 0.5 * self._camera.width / self._unit
        self._box(middle - 140.0, MARGIN, 280.0, 40.0, (*colour, 255))
        place = middle * self._unit, (MARGIN + 20.0) * self._unit
        self._draw.text(place, text, (255, 255, 255), self._large, 'mm')

    def _panel(self, x: float, y: float, width: float, height: float) -> None:
        self._box(x, y, width, height, PANEL)

    def _box(
        self, x: float, y: float, width: float, height: float, paint: tuple[int, int, int, int]
    ) -> None:
        corners = [part * self._unit for part in (x, y, x + width, y + height)]
        self._draw.rounded_rectangle(corners, 6.0 * self._unit, fill=paint)

    def _text(self, x: float, y: float, text: str, colour: Colour, large: bool = False) -> None:
        font = self._large if large else self._font
        self._draw.text((x * self._unit, y * self._unit), text, colour, font)

    def _dot(self, x: float, y: float, colour: Colour) -> None:
        around = [(x - 5.0) * self._unit, (y - 5.0) * self._unit]
        around += [(x + 5.0) * self._unit, (y + 5.0) * self._unit]
        self._draw.ellipse(around, fill=colour)

    def _line(self, points: list[tuple[float, float]], colour: Colour, width: float) -> None:
        scaled = [(x * self._unit, y * self._unit) for x, y in points]
        self._draw.line(scaled, colour, max(round(width * self._unit), 1), 'curve')


def _fares(robot: RobotSight) -> str:
    """Return in a few words how a robot fares."""
    words = [f'{float(np.hypot(*robot.velocity)):.2f} m/s']
    if robot.is_held:
        words.append('held')
    elif robot.is_steered:
        words.append('steered')
    return '  '.join(words)
