"""Parameters of the emulator, besides what its scenario says of emulated robots."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class EmulatorParameters:
    """What holds for all emulated robots of any scenario."""

    torque_limit: float = parameter(33.5, 'Largest torque of a joint', 'Nm', 0.1, 100.0)
    exact_within: float = parameter(
        2.0, 'Clearances are exact up to here, and a lower bound beyond', 'm', 0.0, 100.0
    )
