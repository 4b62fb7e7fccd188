"""What the filter thinks, drawn on the ground: trails, plans, reachable sets, collision balls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser

from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.viewing.palette import robot_colour
from layered_cbf_ros.viewing.scene.colours import Colours, faded, safety_colours
from layered_cbf_ros.viewing.scene.instances import Instances, Lines
from layered_cbf_ros.viewing.scene.robots import as_colours
from layered_cbf_ros.viewing.sight.reach import STEPS, path_ahead
from layered_cbf_ros.viewing.sight.snapshot import Snapshot
from layered_cbf_ros.viewing.solids import Mesh, revolved

TRAIL_PERIOD_NS, TRAIL_POINTS = NS_PER_S // 5, 75
"""A trail tells of the last 15 s."""
SHOWN_H = 2.5
"""Pairs farther from their barrier than this have no ball [m]: nobody could see through all."""
LOW, MIDDLE, HIGH = 0.004, 0.040, 0.045
BALL_LOW, BALL_STEP = 0.008, 0.002
"""Heights above the ground, so that what overlaps doesn't flicker [m]."""


class TrailLayer:
    """Where each robot was planned to be in the last seconds."""

    def __init__(self, scene: viser.SceneApi, names: Sequence[str]) -> None:
        self.lines = Lines(scene, '/trails', 0.022)
        self._names = tuple(names)
        self._points: dict[str, Array] = {}
        self._last_ns = 0

    def draw(self, snapshot: Snapshot) -> None:
        """Draw the trails up to an instant; they begin anew when the time jumps."""
        age_ns = snapshot.stamp_ns - self._last_ns
        if not 0 <= age_ns <= 10 * TRAIL_PERIOD_NS:
            self._points = {}
        elif self._points and age_ns < TRAIL_PERIOD_NS:
            return
        self._last_ns = snapshot.stamp_ns
        pieces, colours = [], []
        for robot in snapshot.robots:
            place = np.array([*robot.configuration[:2], MIDDLE])
            points = self._points.get(robot.name, np.tile(place, (TRAIL_POINTS, 1)))
            points = np.concatenate((points[1:], place[None]))
            self._points[robot.name] = points
            pieces.append(np.stack((points[:-1], points[1:]), axis=1))
            colours.append(faded(robot_colour(self._names.index(robot.name)), TRAIL_POINTS - 1))
        if pieces:
            self.lines.place(np.concatenate(pieces), np.concatenate(colours))


class PlanLayer:
    """Where the plan of each robot leads within the horizon, and its reachable set."""

    def __init__(
        self, scene: viser.SceneApi, names: Sequence[str], parameters: CoordinatorParameters
    ) -> None:
        self._names, self._parameters = tuple(names), parameters
        self.paths = Lines(scene, '/plans', 0.035)
        self.reaches = Instances(scene, '/reachable_sets', disc(), 0.22, casts_shadow=False)

    def draw(self, snapshot: Snapshot) -> None:
        """Draw the plans of an instant."""
        pieces, colours, centres, radii = [], [], [], []
        for robot in snapshot.robots:
            colour = robot_colour(self._names.index(robot.name))
            if robot.plan is not None:
                plan = robot.plan
                path = path_ahead(plan.position, plan.velocity, robot.target, self._parameters)
                lifted = np.column_stack((path, np.full(len(path), HIGH)))
                pieces.append(np.stack((lifted[:-1], lifted[1:]), axis=1))
                colours += [colour] * STEPS
            centres.append((*robot.reach[:2], LOW))
            radii.append(robot.reach[2] + robot.radius)
        self.paths.place(np.concatenate(pieces or [np.empty((0, 2, 3))]), as_colours(colours))
        each = [robot_colour(self._names.index(robot.name)) for robot in snapshot.robots]
        place_discs(self.reaches, centres, radii, as_colours(each))


class BallLayer:
    """The potential-collision ball (q, r) of each pair, coloured by its h."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self.balls = Instances(scene, '/balls/discs', disc(), 0.30, casts_shadow=False)
        self.rims = Instances(scene, '/balls/rims', rim(), casts_shadow=False)

    def draw(self, snapshot: Snapshot) -> None:
        """Draw the balls of an instant, of pairs that are near each other."""
        shown = [ball for ball in snapshot.balls if ball.h < SHOWN_H]
        centres = [(*ball.centre, BALL_LOW + BALL_STEP * k) for k, ball in enumerate(shown)]
        radii = [ball.radius for ball in shown]
        colours = safety_colours(np.array([ball.h for ball in shown]))
        place_discs(self.balls, centres, radii, colours)
        place_discs(self.rims, centres, radii, colours)


def place_discs(
    instances: Instances,
    centres: Sequence[tuple[float, ...]],
    radii: Sequence[float],
    colours: Colours,
) -> None:
    """Put discs of radius 1 to their places [m], as large as they are [m]."""
    radius = np.array(radii, dtype=float)
    scales = np.column_stack((radius, radius, np.ones(len(radius))))
    instances.place(np.array(centres, dtype=float).reshape(-1, 3), colours, scales=scales)


def disc() -> Mesh:
    """Return a flat disc of radius 1, to be seen from above."""
    return revolved([(1.0, 0.0), (0.0, 0.0)], 48)


def rim() -> Mesh:
    """Return the edge of such a disc."""
    return revolved([(1.0, 0.004), (0.97, 0.004)], 64)
