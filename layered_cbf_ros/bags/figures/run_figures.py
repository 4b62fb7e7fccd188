"""The paper's figures of a run (paper section V), drawn from its bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from layered_cbf_ros.bags.figures.drawing import (
    PAIR_COLOURS,
    UNSAFE,
    add_legend,
    colours,
    label_axes,
    new_figure,
    save,
    start_at_zero,
    thin,
)
from layered_cbf_ros.bags.figures.plane_figure import draw_trajectories
from layered_cbf_ros.bags.figures.solve_figure import draw_solve_times
from layered_cbf_ros.bags.run.distances import pair_distances
from layered_cbf_ros.bags.run.run_record import RunRecord, load_run
from layered_cbf_ros.interfaces import Array

CYCLE_S = 0.4
"""Width of a stretch that hides the steps: one gait cycle [s]."""

MOST_NAMED = 28
"""Of more pairs only the nearest are coloured and named."""

UNNAMED = '#d9d9d9'


def draw(bag: Path, folder: Path) -> list[Path]:
    """Draw all figures that the bag has the data for.

    Args:
        bag: An mcap file, a bag's folder or a run's folder.
        folder: Where the PNG files go; made if it is absent.

    Returns:
        The files written.

    Raises:
        BagError: If there is no bag.
    """
    return draw_record(load_run(bag), folder)


def draw_record(record: RunRecord, folder: Path) -> list[Path]:
    """Draw all figures of a run that is loaded already."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, drawing in drawings().items():
        figure = drawing(record)
        if figure is not None:
            written.append(save(figure, folder / f'{name}.png'))
    return written


def drawings() -> dict[str, Callable[[RunRecord], Figure | None]]:
    """Return what draws each figure, by its name, in the order to look at them."""
    return {
        'trajectories': draw_trajectories,
        'distances': draw_distances,
        'barriers': draw_barriers,
        'intervention': draw_intervention,
        'speeds': draw_speeds,
        'torques': draw_torques,
        'solve_times': draw_solve_times,
    }


def draw_distances(record: RunRecord) -> Figure | None:
    """Draw the centre distance of each pair, and the sum of radii below which they'd touch."""
    pairs = pair_distances(record)
    if not pairs:
        return None
    figure, (axis,) = new_figure(8.0, 3.6)
    shades = _pair_colours(record)
    named = _lowest({pair.label: pair.margin for pair in pairs})
    for pair in pairs:
        times, values = thin(pair.times, pair.distances)
        axis.plot(times, values, linewidth=1.2, **_style(pair.label, shades, named))
    sums = sorted({round(pair.promised, 3) for pair in pairs})
    for promised in sums:
        axis.axhline(promised, color=UNSAFE, linewidth=1.0, linestyle='--')
    axis.annotate(
        f'sum of radii {", ".join(f"{promised:g}" for promised in sums)} m', (0.995, sums[-1]),
        xycoords=('axes fraction', 'data'), fontsize=7.5, color=UNSAFE, ha='right', va='bottom',
    )  # fmt: skip
    start_at_zero(axis, *(pair.distances for pair in pairs))
    label_axes(axis, 'time [s]', 'centre distance [m]', 'Distance between bodies')
    add_legend(axis, 1 + (len(named) > 14))
    return figure


def draw_barriers(record: RunRecord) -> Figure | None:
    """Draw psi0 and psi1 of each pair, paper eq. (16): the safe set is psi0, psi1 >= 0."""
    barriers = record.barriers
    if barriers is None:
        return None
    figure, axes = new_figure(8.0, 5.4, rows=2)
    times = record.seconds(barriers.stamps_ns)
    shades = _pair_colours(record)
    walls = _wall_pairs(record)
    lows = np.nanmin(barriers.values[:, 0], axis=0).tolist()
    named = _lowest(dict(zip(barriers.names, lows, strict=True)))
    for row, (axis, unit) in enumerate(zip(axes, ('m', 'm/s'), strict=True)):
        lowest = np.nanmin(barriers.values[:, row], initial=0.0)
        axis.axhspan(min(1.2 * lowest, -0.05), 0.0, color=UNSAFE, alpha=0.08, linewidth=0)
        axis.axhline(0.0, color=UNSAFE, linewidth=1.0, linestyle='--')
        for name, values in zip(barriers.names, barriers.values[:, row].T, strict=True):
            line = ':' if name in walls else '-'
            axis.plot(*thin(times, values), line, linewidth=1.1, **_style(name, shades, named))
        label_axes(axis, 'time [s]' if row else '', rf'$\psi_{row}$ [{unit}]')
    axes[0].set_title('Barriers: the safe set is above zero', fontsize=10, loc='left')
    add_legend(axes[0], 1 + (len(named) > 10))
    return figure


def draw_speeds(record: RunRecord) -> Figure | None:
    """Draw each robot's planned speed and its trunk's, a gait cycle's mean."""
    plan = record.plan
    robots = [name for name in record.motions if plan is not None and name in plan.names]
    if plan is None or not robots:
        return None
    figure, axes = new_figure(8.0, 1.2 + 1.4 * len(robots), rows=len(robots))
    shades = colours(list(record.motions))
    for axis, name in zip(axes, robots, strict=True):
        motion = record.motions[name]
        times = record.seconds(motion.stamps_ns)
        real = _smoothed(motion.configurations[:, :2], times)
        axis.plot(*thin(times, real), color=shades[name], linewidth=1.3, label='measured')
        planned = np.hypot(*plan.values[:, 7:9, plan.names.index(name)].T)
        axis.plot(
            *thin(record.seconds(plan.stamps_ns), planned), color='#222222', linewidth=0.9,
            linestyle=(0, (4, 2)), label='planned',
        )  # fmt: skip
        start_at_zero(axis, real, planned)
        label_axes(axis, '', 'speed [m/s]', name)
    axes[-1].set_xlabel('time [s]', fontsize=9)
    for axis in axes:
        add_legend(axis)
    return figure


def draw_torques(record: RunRecord) -> Figure | None:
    """Draw the largest torque of each robot's hip, upper and lower joints in each gait cycle."""
    legged = {name: motion for name, motion in record.motions.items() if motion.has_legs}
    if not legged:
        return None
    figure, axes = new_figure(8.0, 1.0 + 1.5 * len(legged), rows=len(legged))
    for axis, (name, motion) in zip(axes, legged.items(), strict=True):
        times = record.seconds(motion.stamps_ns)
        for k, (joint, shade) in enumerate(colours(('hip', 'upper', 'lower')).items()):
            strongest = np.abs(motion.torques[:, k::3]).max(axis=1)
            t, peaks = _peaks(times, strongest)
            axis.plot(t, peaks, color=shade, linewidth=1.1, label=joint)
        largest = np.abs(motion.torques).max()
        start_at_zero(axis, np.array([largest]))
        label_axes(axis, '', '|torque| [Nm]', f'{name}: at most {largest:.1f} Nm')
        add_legend(axis)
    axes[-1].set_xlabel('time [s]', fontsize=9)
    return figure


def draw_intervention(record: RunRecord) -> Figure | None:
    """Draw how far the filter moved each robot's acceleration from the desired one."""
    intervention = record.intervention
    if intervention is None:
        return None
    figure, (axis,) = new_figure(8.0, 3.0)
    times = record.seconds(intervention.stamps_ns)
    shades = colours(list(record.motions) or list(intervention.names))
    for name, values in zip(intervention.names, intervention.values[:, 0].T, strict=True):
        shade = shades.get(name, '#444444')
        axis.plot(*thin(times, values), color=shade, linewidth=1.1, label=name)
    start_at_zero(axis, intervention.values[:, 0].ravel())
    title = 'Intervention of the safety filter'
    label_axes(axis, 'time [s]', r'$|u - u_{des}|$ [m/s$^2$]', title)
    add_legend(axis)
    return figure


def _smoothed(positions: Array, times: Array) -> Array:
    """Return the speed over a window that is one gait cycle wide [m/s], (k,)."""
    half = 0.5 * CYCLE_S
    before = np.maximum(times - half, times[0])
    after = np.minimum(times + half, times[-1])
    moved = [np.interp(after, times, p) - np.interp(before, times, p) for p in positions.T]
    return np.hypot(*moved) / np.maximum(after - before, 1e-9)


def _peaks(times: Array, values: Array) -> tuple[Array, Array]:
    """Return the largest value within each stretch that is one gait cycle long."""
    count = max(1, int((times[-1] - times[0]) / CYCLE_S))
    starts = np.unique(np.searchsorted(times, times[0] + CYCLE_S * np.arange(count)))
    return times[starts], np.maximum.reduceat(values, starts)


def _pair_colours(record: RunRecord) -> dict[str, str]:
    """Return the colour of each pair, the same in every figure."""
    names = [pair.label for pair in pair_distances(record)]
    names += () if record.barriers is None else record.barriers.names
    return colours(list(dict.fromkeys(names)), PAIR_COLOURS)


def _lowest(values: Mapping[str, float]) -> set[str]:
    """Return the pairs that are coloured and named: those of the lowest values."""
    return set(sorted(values, key=lambda label: values[label])[:MOST_NAMED])


def _style(label: str, shades: Mapping[str, str], named: set[str]) -> dict[str, Any]:
    """Return colour, name and order of a pair's curve."""
    if label not in named:
        return {'color': UNNAMED, 'zorder': 1}
    return {'color': shades[label], 'label': _pair(label)}


def _wall_pairs(record: RunRecord) -> set[str]:
    """Return the labels of pairs that are a robot and a wall; they are drawn dotted."""
    walls = () if record.scenario is None else record.scenario.walls
    return {f'{robot}~{wall.name}' for robot in record.motions for wall in walls}


def _pair(label: str) -> str:
    return label.replace('~', ' \N{EN DASH} ')
