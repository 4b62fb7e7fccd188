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
    base_lag: float = parameter(
        0.1, 'Time constant with which a base follows its velocity', 's', 0.001, 2.0
    )
    base_acceleration: float = parameter(3.0, 'Largest acceleration of a base', 'm/s^2', 0.1, 50.0)
    base_yaw_acceleration: float = parameter(
        10.0, 'Largest yaw acceleration of a base', 'rad/s^2', 0.1, 100.0
    )
    base_timeout: float = parameter(
        0.2, 'Silence after which a base stops by itself', 's', 0.02, 5.0
    )
    base_margin: float = parameter(
        0.05, "How much smaller than its disc a base's body is", 'm', 0.0, 0.3
    )
