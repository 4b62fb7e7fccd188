"""What any simulated plant tells of the distances between its bodies."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.interfaces import Array


@dataclass(frozen=True, slots=True)
class ClearanceReport:
    """How close the bodies are.

    Attributes:
        stamp_ns: Time of the distances [ns].
        labels: `a~b` of each pair: robot~robot, robot~obstacle, robot~wall, then, of
            robots with legs, robot~ground.
        distances: Surface distance, negative in penetration [m], (P,). Of A1s exact
            below the parameter `exact_within`; from there on a lower bound. Between a
            robot and the ground: that of the trunk.
        forces: Largest normal contact force since the last report [N], (P,).
            Between a robot and the ground: on anything but a toe.
    """

    stamp_ns: int
    labels: tuple[str, ...]
    distances: Array
    forces: Array
