"""Parameters of the ground-force MPC."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter

PAPER_STATE_WEIGHTS = (3e5, 3e7, 3e6, 1e5, 1e5, 1e5, 1e8, 1e8, 1e8, 5e3, 5e3, 5e3)


@dataclass(frozen=True)
class GroundForceParameters:
    """What the middle layer may be told; weights as in paper section IV-A."""

    gait: str = parameter('trot', 'gait of a robot that is not halted', choices=('trot', 'stand'))
    gait_period: float = parameter(0.4, 'time of one swing and one stance', 's', 0.1, 1.0)
    duty: float = parameter(0.5, 'part of the period a foot stands', '', 0.5, 0.9)
    stand_time: float = parameter(0.2, 'time on four feet before the first step', 's', 0.0, 10.0)
    stop_speed: float = parameter(
        0.1, 'a halted robot stands once the motion it brakes along is slower', 'm/s', 0.0, 1.0
    )
    braking: float = parameter(1.0, 'deceleration of a halted robot', 'm/s^2', 0.1, 5.0)
    raibert_gain: float = parameter(
        0.03, 'foothold shift per velocity error (Raibert)', 's', 0.0, 0.3
    )
    position_gain: float = parameter(0.2, 'foothold shift per position error', 'm/m', 0.0, 1.0)
    com_height: float = parameter(0.26, 'height of the CoM over the ground', 'm', 0.15, 0.35)
    horizon: int = parameter(5, 'number of predicted steps N_h', '', 2, 20)
    prediction_step: float = parameter(0.02, 'time of one predicted step', 's', 0.002, 0.1)
    state_weights: tuple[float, ...] = parameter(
        PAPER_STATE_WEIGHTS,
        'diagonal of Q: CoM position, CoM velocity, orientation, angular velocity',
        '',
        0.0,
        1e12,
    )
    terminal_factor: float = parameter(0.1, 'terminal weight P as a multiple of Q', '', 0.0, 100.0)
    force_weight: float = parameter(0.01, 'weight R of each force component', '1/N^2', 1e-6, 1e6)
    friction: float = parameter(0.6, 'friction coefficient the forces may use', '', 0.05, 1.5)
    max_normal_force: float = parameter(250.0, 'largest normal force of a foot', 'N', 10.0, 1000.0)
    force_resolution: float = parameter(1e-2, 'forces are rounded to this', 'N', 1e-9, 1.0)
    solver_tolerance: float = parameter(
        1e-8, 'absolute residual and duality gap of a solution', '', 1e-12, 1e-2
    )
    solver_iterations: int = parameter(50, 'most outer iterations of a solve', '', 1, 10000)
    solver_inner_iterations: int = parameter(
        100, 'most inner iterations of an outer one', '', 1, 10000
    )
