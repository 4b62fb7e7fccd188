"""Parameters of the simulated plant."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class SimulatorParameters:
    """What the simulator node may be told, besides its scenario."""

    torque_limit: float = parameter(33.5, 'Largest torque of a joint', 'Nm', 0.1, 100.0)
    damping: float = parameter(
        2.0, 'Torque per joint speed of a robot that gets no commands', 'Nm s/rad', 0.0, 4.0
    )
    exact_within: float = parameter(
        2.0, 'Clearances are exact up to here, and a lower bound beyond', 'm', 0.0, 100.0
    )
