"""The driver of an A1 as a process, in wall time, with a scripted robot at its other end."""

from __future__ import annotations

import time

import numpy as np
from live_driver import LiveDriver

from benchmarks.row import Row

STANDING_S = 10.0
PRESSES = 8
MS = 1e3


def driver_rows() -> list[Row]:
    """Hold a pose for a while, then press R2 on the remote control, again and again."""
    driver = LiveDriver(pace=1.0)
    try:
        driver.call('arm')
        driver.until_state('standing')
        before = _figures(driver)
        end = time.monotonic() + STANDING_S
        driver.until(lambda: time.monotonic() > end)
        after = _figures(driver)
        reactions = [_reaction_ms(driver) for _ in range(PRESSES)]
    finally:
        driver.close()
    cycles, missed = (after[name] - before[name] for name in ('ticks', 'deadline_misses'))
    details = {name: after[name] for name in ('solve_time_p50_us', 'solve_time_p99_us')}
    lateness = {'cycles': cycles, 'jitter_p99_us': after['jitter_p99_us']}
    return [
        Row(
            'driver: missed deadlines at 1 kHz', 100.0 * missed / max(1.0, cycles), '%', 0.1,
            physical=False, details=details | lateness,
        ),
        Row(
            'driver: from R2 to a damping frame', float(np.median(reactions)), 'ms', 5.0,
            physical=False, details={'max': max(reactions)},
        ),
    ]  # fmt: skip


def _figures(driver: LiveDriver) -> dict[str, float]:
    """Return the figures that the driver tells next."""
    driver.figures = {}
    driver.until(lambda: 'ticks' in driver.figures)
    names = ('ticks', 'deadline_misses', 'jitter_p99_us', 'solve_time_p50_us', 'solve_time_p99_us')
    return {name: float(driver.figures[name]) for name in names}


def _reaction_ms(driver: LiveDriver) -> float:
    """Return the time from the state that tells of a press to the first damping frame [ms]."""
    robot = driver.robot
    if 'standing' not in driver.states[-1]:
        driver.call('reset')
        driver.until_state('disarmed')
        driver.call('arm')
        driver.until_state('standing')
    robot.press('R2')
    driver.until_state('fault')
    driver.until(lambda: robot.frames[-1].damps)
    robot.release()
    first = next(f.at for f in robot.frames if f.at >= robot.told_at and f.damps)
    return MS * (first - robot.told_at)
