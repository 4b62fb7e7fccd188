"""One robot whose layers see only what its sensors tell: closed loop by the estimate."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from closed_loop import ClosedLoop, Motion
from scipy.spatial.transform import Rotation

from layered_cbf_ros.interfaces import Array, GroundForcePlan, Measured, RobotState
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.external_pose import ExternalPose
from layered_cbf_ros.perception.state_estimator import Estimate, EstimatorMemory, StateEstimator
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.plants.emulation.sensors import Sensors
from layered_cbf_ros.scenario_emulation import Emulation

AT_START = StateEstimatorParameters(standing_at_start=True)


A1 = Emulation(
    encoder_noise=0.0005,
    encoder_velocity_noise=0.05,
    gyro_noise=0.005,
    gyro_bias=0.002,
    accelerometer_noise=0.1,
    accelerometer_bias=0.1,
    tilt_bias=0.003,
    yaw_drift=0.0003,
    foot_force_noise=3.0,
    foot_force_offset=10.0,
    foot_force_drift=0.05,
)
"""What the sensors of an A1 get wrong."""


@dataclass(repr=False)
class Sensed:
    """Sees a plant as its robot's sensors do; to be given to a ClosedLoop.

    Attributes:
        measured: What was read, a row a tick.
        plans: What the gait was known to be then.
        truth: The states that it was read from.
        estimates: What was made of it.
        times_ns: How long that took [ns].
    """

    parameters: StateEstimatorParameters = AT_START
    emulation: Emulation = A1
    measured: list[Measured] = field(default_factory=list)
    plans: list[GroundForcePlan | None] = field(default_factory=list)
    truth: list[RobotState] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._sensors = Sensors(self.emulation, np.random.default_rng(1))
        self._estimator = StateEstimator(self.parameters)
        self._memory: EstimatorMemory | None = None

    def __call__(self, plant: BulletWorld, plan: GroundForcePlan | None) -> RobotState:
        """Return the estimated state, as it would be told to the layers."""
        truth = plant.states()[0]
        measured = self._sensors.read(truth, plant.imu(0))
        begun_ns = time.perf_counter_ns()
        estimate = self._estimator.step(self._memory, measured, plan)
        self.times_ns.append(time.perf_counter_ns() - begun_ns)
        self._memory = estimate.memory
        for row, value in zip(
            (self.measured, self.plans, self.truth, self.estimates),
            (measured, plan, truth, estimate),
            strict=True,
        ):
            row.append(value)
        return estimate.state


@dataclass(frozen=True)
class Errors:
    """How wrong estimates are, from a tick on.

    Attributes:
        walked: Length of the true path in the plane [m].
        drift: Distance in the plane between estimate and truth at the end [m].
        velocity: Root mean square of the velocity error, world axes [m/s], (3,).
        height: Largest error of the base's height [m].
        yaw: Error of the heading at the end [rad].
    """

    walked: float
    drift: float
    velocity: Array
    height: float
    yaw: float


def errors(estimates: list[RobotState], truth: list[RobotState]) -> Errors:
    """Compare estimated states with true ones."""
    found, true = (np.array([s.configuration[:7] for s in row]) for row in (estimates, truth))
    turns = [Rotation.from_quat(poses[:, 3:]) for poses in (found, true)]
    speeds = [
        turn.apply([s.velocity[:3] for s in row])
        for turn, row in zip(turns, (estimates, truth), strict=True)
    ]
    yaw = (turns[0][-1] * turns[1][-1].inv()).as_rotvec()[2]
    return Errors(
        float(np.hypot(*np.diff(true[:, :2], axis=0).T).sum()),
        float(np.hypot(*(found - true)[-1, :2])),
        np.sqrt(((speeds[0] - speeds[1]) ** 2).mean(axis=0)),
        float(np.abs(found - true)[:, 2].max()),
        float(yaw),
    )


def walked(motion: Motion, duration: float, sensed: Sensed) -> Sensed:
    """Let the layers walk by what is sensed [s]; return it."""
    ClosedLoop(motion, sensed=sensed).run(duration)
    return sensed


def again(
    sensed: Sensed,
    parameters: StateEstimatorParameters = AT_START,
    poses: dict[int, list[ExternalPose]] | None = None,
    **changes,
) -> list[Estimate]:
    """Estimate anew from what was measured.

    Args:
        sensed: What was measured.
        parameters: Of the estimator.
        poses: What is seen from outside, by the tick at which it arrives.
        changes: Of measured fields, functions from tick and value to another value;
            `plan` is one of them, too.
    """
    estimator, memory, found = StateEstimator(parameters), None, []
    for tick, (measured, plan) in enumerate(zip(sensed.measured, sensed.plans, strict=True)):
        given = {name: getattr(measured, name) for name in measured.__slots__} | {'plan': plan}
        given |= {name: change(tick, given[name]) for name, change in changes.items()}
        plan_ = given.pop('plan')
        estimate = estimator.step(memory, Measured(**given), plan_, (poses or {}).get(tick, ()))
        memory = estimate.memory
        found.append(estimate)
    return found
