"""Planned ground forces: inside the friction pyramid in stance, none in swing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.evidence import FORCES, Evidence
from layered_cbf_ros.bags.audit.findings import Check, Samples, at_least, at_most, not_proven
from layered_cbf_ros.bags.audit.limits import Limits
from layered_cbf_ros.bags.audit.run_parameters import RunParameters
from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.interfaces import LEGS, Array

FRICTION, LEAST, LARGEST, SWING = (
    'force beyond friction cone', 'least normal force', 'largest normal force', 'swing foot force',
)  # fmt: skip
NAMES = (FRICTION, LEAST, LARGEST, SWING)
RATE, FORCE = range(2)


def check_forces(evidence: Evidence, run: RunParameters | None, limits: Limits) -> list[Check]:
    """Check the planned force of every foot of every robot."""
    if run is None:
        return [not_proven(name, 'its parameters are not known') for name in NAMES]
    found: dict[str, list[Samples]] = {name: [] for name in NAMES}
    holes, slack = [], limits.force_rounding
    for robot in evidence.robots:
        trace = evidence.traces.get(f'/{robot}/{FORCES}')
        if trace is None:
            holes.append(f'no /{robot}/{FORCES}')
            continue
        times = evidence.seconds(trace.series.stamps_ns)
        for leg in LEGS:
            force, swings = _foot(trace.series, leg)
            subject, stands = f'{robot}/{leg}_foot', ~swings
            x, y, z = force[stands].T
            beyond = np.maximum(np.abs(x), np.abs(y)) - run.friction * z
            standing = times[stands]
            found[FRICTION].append(Samples(subject, standing, beyond, slack))
            found[LEAST].append(Samples(subject, standing, z, -slack))
            found[LARGEST].append(Samples(subject, standing, z, run.max_normal_force + slack))
            size = np.abs(force[swings]).max(axis=1)
            found[SWING].append(Samples(subject, times[swings], size, 0.0))
    pyramid = f'|fx|, |fy| <= {run.friction:g} fz in stance'
    return [
        at_most(FRICTION, 'N', found[FRICTION], holes, [pyramid]),
        at_least(LEAST, 'N', found[LEAST], holes),
        at_most(LARGEST, 'N', found[LARGEST], holes),
        at_most(SWING, 'N', found[SWING], holes),
    ]


def _foot(series: Series, leg: str) -> tuple[Array, NDArray[np.bool_]]:
    """Return the force on a foot in the world [N], (k, 3), and when it swings, (k,)."""
    axes = series.columns([f'{leg}_foot_{axis}' for axis in 'xyz'])
    (phase,) = series.columns([f'{leg}_foot_phase'])
    return series.values[:, FORCE, axes], series.values[:, RATE, phase] != 0.0
