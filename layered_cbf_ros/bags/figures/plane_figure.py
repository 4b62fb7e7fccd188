"""Trajectories in the plane: who was where, and when (paper fig. 5 a, b)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.transforms import Affine2D

from layered_cbf_ros.bags.figures.drawing import (
    OBSTACLE_COLOURS,
    add_legend,
    colours,
    label_axes,
    new_figure,
)
from layered_cbf_ros.bags.run.measures import smallest_clearance
from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Scenario

FOOTPRINT = np.array([(-0.22, -0.13), (0.16, -0.13), (0.25, 0.0), (0.16, 0.13), (-0.22, 0.13)])
"""Outline of a robot with a pointed head, heading frame [m]."""

FOOTPRINTS = 8
SAMPLES = 400
MARGIN = 0.7
LEAST_ASPECT = 1.3


def draw_trajectories(record: RunRecord) -> Figure | None:
    """Draw the paths, fading towards the past, with bodies at equal times, walls and goals."""
    if not record.motions:
        return None
    low, high = _bounds(record)
    width, height = high - low
    figure, (axis,) = new_figure(9.0, float(np.clip(1.1 + 7.4 * height / width, 2.8, 8.0)))
    axis.set_aspect('equal')
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1])
    if record.scenario is not None:
        _draw_walls(axis, record.scenario, low, high)
        _draw_obstacles(axis, record, record.scenario)
        _draw_goals(axis, record.scenario, colours(list(record.motions)))
    for name, shade in colours(list(record.motions)).items():
        _draw_robot(axis, record, name, shade)
    label_axes(axis, 'x [m]', 'y [m]', _title(record))
    add_legend(axis)
    return figure


def _draw_robot(axis: Axes, record: RunRecord, name: str, shade: str) -> None:
    motion = record.motions[name]
    rows = np.linspace(0, len(motion.stamps_ns) - 1, SAMPLES).astype(int)
    _fading_line(axis, motion.configurations[rows, :2], shade, 2.0)
    axis.plot([], [], color=shade, linewidth=2.0, label=name)
    axis.plot(*motion.configurations[0, :2], marker='o', color=shade, markersize=4, zorder=5)
    for k, row in enumerate(np.linspace(0, rows[-1], FOOTPRINTS).astype(int)):
        x, y = motion.configurations[row, :2]
        turned = Affine2D().rotate(_yaw(motion.configurations[row, 3:7])).translate(x, y)
        outline = turned.transform(FOOTPRINT)
        strength = (k + 1) / FOOTPRINTS
        axis.fill(*outline.T, color=shade, alpha=0.12 + 0.5 * strength**2, linewidth=0, zorder=4)


def _draw_obstacles(axis: Axes, record: RunRecord, scenario: Scenario) -> None:
    if record.obstacles is None:
        return
    positions = record.obstacles.positions
    shades = colours([obstacle.name for obstacle in scenario.obstacles], OBSTACLE_COLOURS)
    for k, obstacle in enumerate(scenario.obstacles[: positions.shape[1]]):
        rows = np.linspace(0, len(positions) - 1, SAMPLES).astype(int)
        shade = shades[obstacle.name]
        _fading_line(axis, positions[rows, k], shade, 1.2)
        axis.plot([], [], color=shade, linewidth=1.2, label=obstacle.name)
        for j, row in enumerate(np.linspace(0, rows[-1], FOOTPRINTS).astype(int)):
            strength = ((j + 1) / FOOTPRINTS) ** 2
            centre = (float(positions[row, k, 0]), float(positions[row, k, 1]))
            body = Circle(centre, obstacle.radius, color=shade, alpha=0.05 + 0.5 * strength)
            body.set_linewidth(0)
            axis.add_patch(body)


def _draw_walls(axis: Axes, scenario: Scenario, low: Array, high: Array) -> None:
    """Draw each half-plane's surface, hatched on the forbidden side."""
    reach = float(np.hypot(*(high - low)))
    for wall in scenario.walls:
        point, normal = np.array(wall.point), np.array(wall.normal)
        point = point + np.array([-normal[1], normal[0]]) * (
            (0.5 * (low + high) - point) @ np.array([-normal[1], normal[0]])
        )
        along = reach * np.array([-normal[1], normal[0]])
        surface = np.array([point - along, point + along])
        behind = surface[::-1] - MARGIN * normal
        axis.fill(
            *np.concatenate((surface, behind)).T, facecolor='#efefef', edgecolor='#c8c8c8',
            hatch='////', linewidth=0, zorder=1,
        )  # fmt: skip
        axis.plot(*surface.T, color='#555555', linewidth=1.4, zorder=2)


def _draw_goals(axis: Axes, scenario: Scenario, shades: dict[str, str]) -> None:
    for robot in scenario.robots:
        if robot.desired.goal is not None:
            axis.plot(
                *robot.desired.goal, marker='*', markersize=13, color=shades.get(robot.name, 'k'),
                markeredgecolor='white', markeredgewidth=0.6, zorder=6,
            )  # fmt: skip


def _fading_line(axis: Axes, points: Array, shade: str, width: float) -> None:
    segments = np.stack((points[:-1], points[1:]), axis=1)
    alphas = np.linspace(0.15, 1.0, len(segments))
    axis.add_collection(
        LineCollection(list(segments), colors=shade, alpha=alphas, linewidths=width, zorder=3)
    )


def _bounds(record: RunRecord) -> tuple[Array, Array]:
    """Return the corners of what must be seen [m]."""
    points = [motion.configurations[:, :2] for motion in record.motions.values()]
    if record.obstacles is not None:
        points.append(record.obstacles.positions.reshape(-1, 2))
    if record.scenario is not None:
        goals = [robot.desired.goal for robot in record.scenario.robots]
        points += [np.array([goal]) for goal in goals if goal is not None]
        points += [_foot(wall.point, wall.normal, points[0]) for wall in record.scenario.walls]
    everything = np.concatenate(points)
    everything = everything[np.isfinite(everything).all(axis=1)]
    if not len(everything):
        return np.full(2, -MARGIN), np.full(2, MARGIN)
    low, high = everything.min(axis=0) - MARGIN, everything.max(axis=0) + MARGIN
    widening = max(0.0, LEAST_ASPECT * (high[1] - low[1]) - (high[0] - low[0]))
    aside = np.array([0.5 * widening, 0.0])
    return low - aside, high + aside


def _foot(point: tuple[float, float], normal: tuple[float, float], near: Array) -> Array:
    """Return the point of a wall that is nearest to the middle of a path, (1, 2)."""
    middle, n = near.mean(axis=0), np.array(normal)
    return (middle - n * ((middle - point) @ n))[None]


def _yaw(quaternion: Array) -> float:
    x, y, z, w = quaternion
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _title(record: RunRecord) -> str:
    name = 'Trajectories' if record.scenario is None else record.scenario.name
    clearance = smallest_clearance(record)
    if clearance is None:
        return name
    return f'{name}: never closer than {clearance[0]:.2f} m, surface to surface'
