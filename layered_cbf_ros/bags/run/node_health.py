"""What the nodes of a run told of themselves on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.health import TOLD_BY
from layered_cbf_ros.interfaces import Array

COUNTERS = ('solver_failures', 'slack_events', 'deadline_misses', 'rejected')
SOLVE_TIMES = ('solve_time_p50_us', 'solve_time_p99_us', 'solve_time_max_us')


@dataclass(frozen=True, slots=True)
class SolveTimes:
    """How long a node computed, as it told about once a second.

    Attributes:
        stamps_ns: The newest state when it told [ns], (k,).
        times: Median and 99th percentile of its last few thousand ticks, and the
            longest so far [us], (k, 3).
    """

    stamps_ns: NDArray[np.int64]
    times: Array


class NodeHealth:
    """Gathers /diagnostics; a counter that falls back tells of a restart.

    Attributes:
        last: The last key-values, by node.
    """

    def __init__(self) -> None:
        self.last: dict[str, dict[str, str]] = {}
        self._before_restart: dict[str, dict[str, int]] = {}
        self._solve_times: dict[str, list[tuple[int, list[float]]]] = {}

    def add(self, message: Any, state_ns: int | None) -> None:
        """Take one diagnostic_msgs/DiagnosticArray.

        Args:
            message: As rosbags decodes it.
            state_ns: Stamp of the newest state [ns], None before the first.
        """
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            if values.get(TOLD_BY):  # repeated by somebody else, for a node that fell silent
                continue
            lost = self._before_restart.setdefault(status.name, dict.fromkeys(COUNTERS, 0))
            previous = self.last.get(status.name, {})
            for key in COUNTERS:
                if _count(values, key) < _count(previous, key):
                    lost[key] += _count(previous, key)
            self.last[status.name] = values
            times = [float(_count(values, key)) for key in SOLVE_TIMES]
            if state_ns is not None and any(times):
                self._solve_times.setdefault(status.name, []).append((state_ns, times))

    def totals(self) -> dict[str, dict[str, int]]:
        """Return the sum of each counter over the life of a node and its restarts, by node."""
        return {
            node: {key: lost[key] + _count(self.last[node], key) for key in COUNTERS}
            for node, lost in self._before_restart.items()
        }

    def solve_times(self) -> dict[str, SolveTimes]:
        """Return how long each node computed that told it, by node in the order of names."""
        return {
            node: SolveTimes(
                np.array([stamp for stamp, _ in rows], dtype=np.int64),
                np.array([times for _, times in rows]),
            )
            for node, rows in sorted(self._solve_times.items())
        }


def _count(values: Mapping[str, str], key: str) -> int:
    """Return a number of a diagnostic status; 0 where it is absent or no whole number."""
    text = values.get(key, '0')
    return int(text) if text.isdigit() else 0
