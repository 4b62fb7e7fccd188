"""Parameters of the whole-body controller; values in params/whole_body_controller.yaml."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class WholeBodyParameters:
    """Gains and weights of paper III-F and V, limits, solver settings."""

    com_height: float = parameter(
        0.26, 'height of the CoM over the ground', 'm', minimum=0.15, maximum=0.35
    )
    braking: float = parameter(
        1.0,
        'deceleration of a robot whose coordinator is silent',
        'm/s^2',
        minimum=0.1,
        maximum=5.0,
    )
    step_height: float = parameter(
        0.06, 'rise of a toe halfway through its swing', 'm', minimum=0.0, maximum=0.2
    )
    body_stiffness: float = parameter(
        100.0, 'gain on CoM and orientation errors', '1/s^2', minimum=0.0
    )
    body_damping: float = parameter(20.0, 'gain on their rates', '1/s', minimum=0.0)
    swing_stiffness: float = parameter(
        400.0, 'gain on position errors of swing feet', '1/s^2', minimum=0.0
    )
    swing_damping: float = parameter(40.0, 'gain on their rates', '1/s', minimum=0.0)
    torque_weight: float = parameter(1e2, 'nu_1, on joint torques', '1/(Nm)^2', minimum=0.0)
    force_weight: float = parameter(
        1e3, 'nu_2, on the distance to the planned forces', '1/N^2', minimum=0.0
    )
    defect_weight: float = parameter(
        1e7, 'nu_3, on the defect of the output dynamics', 's^4/m^2', minimum=0.0
    )
    friction: float = parameter(
        0.6, 'friction coefficient; at most 0.8 of the real one', minimum=0.05, maximum=2.0
    )
    torque_limit: float = parameter(
        33.5, 'largest torque of every joint', 'Nm', minimum=1.0, maximum=33.5
    )
    torque_resolution: float = parameter(
        1e-4, 'torques are rounded to this', 'Nm', minimum=1e-9, maximum=0.1
    )
    joint_damping: float = parameter(
        2.0, 'damping of the joints when no torque is known', 'Nms/rad', minimum=0.0, maximum=20.0
    )
    sit_height: float = parameter(
        0.062,
        'planned CoM height below which the robot lies damped',
        'm',
        minimum=0.0,
        maximum=0.25,
    )
    fall_gap: float = parameter(
        0.13, 'a robot that is lower than planned by this is damped', 'm', 0.05, 0.3
    )
    rise_gap: float = parameter(
        0.05, 'a damped robot rises only with a plan this near above it', 'm', 0.0, 0.1
    )
    height_step: float = parameter(
        0.02, 'a robot whose plan leaps up by more is damped', 'm', 0.001, 0.1
    )
    damping_tilt: float = parameter(
        35.0, 'a robot that is tilted farther is damped', 'deg', 5.0, 90.0
    )
    cost_scale: float = parameter(
        1e-4, 'factor on the whole cost, for its conditioning', minimum=1e-9, maximum=1.0
    )
    tolerance: float = parameter(
        1e-6, 'residuals and duality gap at which the solver stops', minimum=1e-9, maximum=1e-3
    )
    accepted_residual: float = parameter(
        1e-3, 'largest violation of a constraint in an accepted solution', minimum=1e-8, maximum=1.0
    )
    max_iterations: int = parameter(50, 'outer iterations', minimum=1, maximum=10_000)
    max_inner_iterations: int = parameter(
        100, 'inner iterations of each outer one', minimum=1, maximum=10_000
    )
