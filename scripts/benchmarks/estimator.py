"""The state estimator in closed loop: how far off a robot is that walks by its own sensors."""

from __future__ import annotations

import math

import numpy as np
from closed_loop import walk
from sensed import Sensed, errors, walked

from benchmarks.row import Row

WALKS = {
    '0.5 m/s forward': {'forward': 0.5},
    '0.4 m/s, turning at 0.5 rad/s': {'forward': 0.4, 'yaw_rate': 0.5},
}
SECONDS = 12.0
STEADY = 2000
"""Tick by which the walk has its speed."""


def estimator_rows() -> list[Row]:
    """Walk by the estimate, with the sensors of an A1."""
    rows = []
    for name, velocity in WALKS.items():
        seen = walked(walk(**velocity), SECONDS, Sensed())
        states = [estimate.state for estimate in seen.estimates]
        whole, steady = errors(states, seen.truth), errors(states[STEADY:], seen.truth[STEADY:])
        drift, way = 100.0 * whole.drift / whole.walked, {'walked_m': whole.walked}
        rmse = float(np.linalg.norm(steady.velocity))
        turned = {'yaw_error_deg': math.degrees(whole.yaw)}
        rows += [
            Row(f'estimator, {name}: drift', drift, '%', 2.0, 0.5, details=way | turned),
            Row(f'estimator, {name}: velocity RMSE', rmse, 'm/s', 0.05, 0.005),
            Row(f'estimator, {name}: height error', 1e3 * whole.height, 'mm', 10.0, 1.0),
        ]
    p50, p99 = np.percentile(seen.times_ns, (50, 99)) / 1e3
    speed = Row('estimator: tick', p50, 'us', 300.0, 150.0, physical=False, details={'p99': p99})
    return [*rows, speed]
