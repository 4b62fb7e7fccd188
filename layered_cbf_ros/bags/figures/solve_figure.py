"""How long each node computed, and how long it may."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from layered_cbf_ros.bags.figures.drawing import UNSAFE, add_legend, label_axes, new_figure
from layered_cbf_ros.bags.run.node_health import SolveTimes
from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import LOCKSTEP

MPC, TRACKER = 'ground_force_mpc', 'obstacle_tracker'
CURVES = (('median', '-', 1.4), ('99 %', '-', 0.9), ('longest so far', ':', 1.0))
SHADES = ('#0072b2', '#56b4e9', '#7f7f7f')
ASIDE = ('recorder', 'supervisor', 'teleop', 'viewer')  # nobody's next tick waits for them
COLUMNS = 2
TICKS = (1.0, 3.0)
US_PER_S = 1e6


def draw_solve_times(record: RunRecord) -> Figure | None:
    """Draw the time a tick of each node took, beside the time between two ticks."""
    nodes = {
        name: times
        for name, times in record.solve_times.items()
        if len(times.stamps_ns) > 1 and name.rpartition('/')[2] not in ASIDE
    }
    if not nodes:
        return None
    columns = min(COLUMNS, len(nodes))
    rows = -(-len(nodes) // columns)
    figure, axes = new_figure(8.0, 1.0 + 1.3 * rows, rows, columns)
    for axis, (name, times) in zip(axes, nodes.items(), strict=False):
        deadline = None if record.scenario is None else deadline_us(name, record.scenario)
        _draw_node(axis, record.seconds(times.stamps_ns), times, deadline)
        label_axes(axis, '', '', name.strip('/'))
    for axis in axes[len(nodes) :]:  # beside the last, if their number is odd
        axis.axis('off')
        axes[len(nodes) - columns].tick_params(labelbottom=True)
    waits = record.scenario is not None and record.scenario.time == LOCKSTEP
    title = 'Time a tick takes' + (': in lockstep everybody is waited for' if waits else '')
    figure.suptitle(title, fontsize=10, x=0.01, ha='left')
    figure.supxlabel('time [s]', fontsize=9)
    figure.supylabel('solve time [ms]', fontsize=9)
    add_legend(axes[columns - 1])
    return figure


def deadline_us(node: str, scenario: Scenario) -> float:
    """Return the time between two ticks of a node [us]."""
    kind = node.rpartition('/')[2]
    rates = scenario.rates
    rate = {MPC: rates.plan, TRACKER: rates.detections}.get(kind, rates.state)
    return US_PER_S / rate


def _draw_node(axis: Axes, seconds: Array, told: SolveTimes, deadline: float | None) -> None:
    milliseconds = told.times / 1e3
    for values, shade, (label, style, width) in zip(milliseconds.T, SHADES, CURVES, strict=True):
        axis.plot(seconds, values, style, color=shade, linewidth=width, label=label)
    axis.set_yscale('log')
    lowest, highest = float(np.min(milliseconds[milliseconds > 0.0])), float(milliseconds.max())
    if deadline is not None:
        axis.axhline(
            deadline / 1e3, color=UNSAFE, linewidth=1.0, linestyle='--', label='time to next tick'
        )
        lowest, highest = min(lowest, deadline / 1e3), max(highest, deadline / 1e3)
    axis.set_ylim(0.7 * lowest, 1.5 * highest)
    axis.yaxis.set_major_locator(LogLocator(subs=TICKS))
    axis.yaxis.set_major_formatter(FormatStrFormatter('%g'))
    axis.yaxis.set_minor_locator(NullLocator())
