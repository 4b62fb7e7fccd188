"""The common look of all figures: one colour a body, thin lines, few ticks, small files."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from layered_cbf_ros.interfaces import Array

ROBOT_COLOURS = (
    '#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#7a5195', '#666666',
)  # fmt: skip
OBSTACLE_COLOURS = ('#4d4d4d', '#7f7f7f', '#a6a6a6', '#8c6d46', '#b0a089')
PAIR_COLOURS = (
    '#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#7a5195', '#4d4d4d',
    '#a05195', '#2f4b7c', '#8c6d46', '#b0a089',
)  # fmt: skip
UNSAFE = '#b2182b'
DPI = 130
MOST_POINTS = 1200
PALETTE_SIZE = 96


def colours(names: Sequence[str], palette: Sequence[str] = ROBOT_COLOURS) -> dict[str, str]:
    """Return a colour for each name, by its place."""
    return {name: palette[i % len(palette)] for i, name in enumerate(names)}


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1
) -> tuple[Figure, list[Axes]]:
    """Return a figure [inch] and its axes, row by row; those of a column share their x axis."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout='constrained')
    axes = figure.subplots(rows, columns, sharex='col', squeeze=False).ravel().tolist()
    for axis in axes:
        axis.spines[['top', 'right']].set_visible(False)
        axis.grid(True, color='#e6e6e6', linewidth=0.6)
        axis.set_axisbelow(True)
        axis.tick_params(labelsize=8)
        axis.margins(x=0.01)
    return figure, axes


def label_axes(axis: Axes, x: str, y: str, title: str = '') -> None:
    """Label an axis pair."""
    axis.set_xlabel(x, fontsize=9)
    axis.set_ylabel(y, fontsize=9)
    if title:
        axis.set_title(title, fontsize=10, loc='left')


def start_at_zero(axis: Axes, *curves: Array) -> None:
    """Let the y axis run from zero to a little above the highest of some curves."""
    highest = max(float(curve[np.isfinite(curve)].max(initial=0.0)) for curve in curves)
    axis.set_ylim(0.0, 1.08 * highest if highest > 0.0 else 1.0)


def add_legend(axis: Axes, columns: int = 1) -> None:
    """Put a legend to the right of an axis, if it has anything to tell."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(
            handles, labels, fontsize=7.5, frameon=False, ncols=columns,
            loc='upper left', bbox_to_anchor=(1.0, 1.02), borderaxespad=0.2, handlelength=1.4,
        )  # fmt: skip


def thin(times: Array, values: Array) -> tuple[Array, Array]:
    """Return what is worth drawing of a curve: the extremes of each stretch survive.

    Args:
        times: Increasing, (k,).
        values: (k,).
    """
    stretch = 2 * len(times) // MOST_POINTS
    if stretch < 2:
        return times, values
    whole = len(times) // stretch * stretch
    blocks = np.nan_to_num(values[:whole]).reshape(-1, stretch)
    starts = np.arange(0, whole, stretch)
    rows = np.concatenate(
        (starts + blocks.argmin(axis=1), starts + blocks.argmax(axis=1), [len(times) - 1])
    )
    kept = np.unique(rows)
    return times[kept], values[kept]


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG of few colours, which keeps it small; return its path."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', facecolor='white', bbox_inches='tight', pad_inches=0.08)
    picture = Image.open(buffer).convert('RGB')
    picture.quantize(PALETTE_SIZE, dither=Image.Dither.NONE).save(path, optimize=True)
    return path
