"""Which tracks the coordinator used at each of its ticks, by the timing rule of the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.run_parameters import timing_of
from layered_cbf_ros.bags.audit.trace import Trace
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import REAL_TIME, InputRules

NEAR = (0, -1, -2)
FAR = tuple(range(-12, 11))
"""In real time, which stamps of a track a tick may have used, counted from the newest that
is no newer than the tick: first those that are likely, then all that are possible. A tick
that comes late finds tracks that are newer than itself."""

SETTLED_NS = NS_PER_S * 12 // 100
"""After this time a track must have reached the coordinator [ns]."""


@dataclass(frozen=True, slots=True)
class TrackRows:
    """What the coordinator may have known of one track at each of K stamps.

    Attributes:
        states: poses.TRACK_FIELDS of each candidate, the likeliest first, (C, K, 10).
        stamps_ns: Of these [ns], (C, K).
        present: Whether there is such a candidate, (C, K).
        certain: Whether the track must have been known, (K,).
    """

    states: Array
    stamps_ns: NDArray[np.int64]
    present: NDArray[np.bool_]
    certain: NDArray[np.bool_]

    def part(self, rows: slice) -> TrackRows:
        """Return some of the stamps."""
        return TrackRows(
            self.states[:, rows],
            self.stamps_ns[:, rows],
            self.present[:, rows],
            self.certain[rows],
        )


def track_rows(
    scenario: Scenario, trace: Trace, stamps_ns: NDArray[np.int64], offsets: Sequence[int] = NEAR
) -> TrackRows:
    """Return what was known of a track at each stamp.

    In lockstep that is the track of exactly one stamp. In real time the newest that had
    come counts, which the bag doesn't tell: each of several may be it.

    Args:
        scenario: Its rates count.
        trace: The track.
        stamps_ns: Of the coordinator's ticks [ns], (K,).
        offsets: In real time, which of its stamps to try.
    """
    timing, known = timing_of(scenario), trace.series.stamps_ns
    if timing.time == REAL_TIME:
        newest = np.searchsorted(known, stamps_ns, side='right') - 1
        rows = newest + np.array(offsets)[:, None]
        present = (rows >= 0) & (rows < len(known))
        certain = (stamps_ns - SETTLED_NS >= known[0]) & (stamps_ns <= known[-1])
    else:
        rule = InputRules(timing).tracks
        wanted = (stamps_ns - rule.latency_ns) // rule.period_ns * rule.period_ns
        rows = np.searchsorted(known, wanted)[None]
        rows = np.minimum(rows, len(known) - 1)
        present = (known[rows] == wanted) & (wanted >= 0)
        certain = present[0]
    rows = np.clip(rows, 0, len(known) - 1)
    return TrackRows(trace.series.values[rows, :, 0], known[rows], present, certain)
