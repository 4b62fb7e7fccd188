"""What a run must keep, beyond what its own scenario promises."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from layered_cbf_ros.bags.tables import aligned
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class Limits:
    """Limits that the user may change; unit and meaning stand in each field.

    Radii, decay rates, friction, input limits and the ages allowed in real time come
    from the scenario in the bag. Joint angles are limited by the robot's URDF. Its
    effort and velocity limits are not used: the copy in pybullet_data allows 20 and
    55 Nm, 52 and 29 rad/s where the maker of the A1 allows 33.5 Nm and 21 rad/s.
    """

    distance_slip: float = parameter(
        0.03, 'by how much centres may be nearer than the radii: these guard the planned CoM', 'm'
    )
    clearance: float = parameter(0.0, 'surfaces must be farther apart than this', 'm')
    barrier: float = parameter(0.0, 'least psi0 and psi1', 'm, m/s')
    barrier_difference: float = parameter(
        1e-6, 'published psi0, psi1 outside of the range recomputed; is rounding', 'm, m/s'
    )
    plan_step: float = parameter(
        1e-9, 'planned motion beside the integral of its inputs; is rounding', 'm, m/s, m/s^2'
    )
    plan_rounding: float = parameter(
        1e-6, 'excess of planned speeds and accelerations that is rounding', 'm/s, m/s^2'
    )
    plan_error: float = parameter(0.1, 'distance of a CoM from its plan, in the plane', 'm')
    tilt: float = parameter(30.0, 'roll and pitch', 'deg')
    height: float = parameter(0.12, 'least height of the trunk; below it the robot lies', 'm')
    torque: float = parameter(33.5, 'joint torque, measured and commanded', 'Nm')
    joint_speed: float = parameter(21.0, 'joint speed', 'rad/s')
    joint_excess: float = parameter(0.0, 'joint angle beyond the range of the URDF', 'rad')
    force_rounding: float = parameter(
        0.01, 'excess of planned forces over pyramid and limit that is rounding', 'N'
    )
    silence: float = parameter(0.1, 'time between messages of a topic in real time', 's')
    jitter: float = parameter(0.1, 'log time beside the stamps between messages, real time', 's')


def limits_from(changes: Sequence[str]) -> Limits:
    """Return the limits with some changed.

    Args:
        changes: `NAME=VALUE` each.

    Raises:
        BagError: If a name is unknown or a value is no finite number.
    """
    names = [field.name for field in dataclasses.fields(Limits)]
    values: dict[str, float] = {}
    for change in changes:
        name, _, text = change.partition('=')
        if name not in names:
            raise BagError(f"--limit '{change}': no limit '{name}'; there are {', '.join(names)}")
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = math.nan
        if not math.isfinite(values[name]):
            raise BagError(f"--limit '{change}': '{text}' is no number; say {name}=VALUE")
    return dataclasses.replace(Limits(), **values)


def described(limits: Limits) -> list[str]:
    """Return the limits as aligned lines: name, value, unit and meaning."""
    rows = [
        (
            field.name,
            f'{getattr(limits, field.name):g}',
            field.metadata['unit'],
            field.metadata['description'],
        )
        for field in dataclasses.fields(limits)
    ]
    return aligned(rows)
