"""Kalman filter of a robot that its accelerometer moves and its standing feet hold.

State: position p and velocity v of the base, bias b of the accelerometer and the
centres f of the toes, all in the world. The orientation R is known. Then

    p' = v,  v' = R a + g - b,  b' = 0,  f' = what the toe rolls on its ground,

and measured are all feet, f - p, and of those that stand: v, as minus the velocity
of the contact point seen from the base, and the height of the ground.

All noise is alike in all directions. So the axes do not know of each other, and x and
y have one covariance, z another: two of 7 x 7 do the work of one of 21 x 21.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from layered_cbf_ros.interfaces import GRAVITY, TOE_RADIUS, Array
from layered_cbf_ros.perception.estimator_parameters import StateEstimatorParameters
from layered_cbf_ros.perception.leg_odometry import LegMotion

POSITION, VELOCITY, BIAS, FEET = 0, 1, 2, slice(3, 7)
STATES = 7
PLANE, VERTICAL = 0, 1
_FEET = np.arange(3, 7)
_GRAVITY = np.array([0.0, 0.0, -GRAVITY])
_FREE = 1.0  # random walk of a foot in the air [m/sqrt(s)]: it will stand anywhere
_UNKNOWN = 10.0  # acceleration while nothing was measured [m/s^2]


@dataclass(frozen=True, slots=True)
class Belief:
    """What is known of one robot.

    Attributes:
        mean: p [m], v [m/s], b [m/s^2] and four feet [m], world, (7, 3).
        covariance: Of the state along x or y, and along z, (2, 7, 7).
        rotation: Base frame to world, (3, 3).
    """

    mean: Array
    covariance: Array
    rotation: Array


class ContactAidedFilter:
    """The two steps of the filter, and what else may be learned."""

    def __init__(self, parameters: StateEstimatorParameters) -> None:
        """Set what does not change."""
        self._parameters = parameters
        self._identity = np.eye(STATES)
        self._foot = parameters.leg_noise**-2
        self._speed = parameters.leg_velocity_noise**-2
        self._ground = parameters.ground_noise**-2
        self._legs = np.zeros((2, STATES, STATES))
        self._legs[:, POSITION, POSITION] = 4.0 * self._foot
        self._legs[:, POSITION, FEET] = self._legs[:, FEET, POSITION] = -self._foot
        self._legs[:, _FEET, _FEET] = self._foot

    def start(self, plane: Array, spread: float, rotation: Array, legs: LegMotion) -> Belief:
        """Return what is known of a robot that stands still.

        Args:
            plane: Where its base is in the plane [m], (2,).
            spread: Standard deviation of each coordinate [m].
            rotation: Base frame to world, (3, 3).
            legs: How it stands.
        """
        position = np.append(plane, TOE_RADIUS - legs.feet[:, 2].mean())
        mean = np.zeros((STATES, 3))
        mean[POSITION], mean[FEET] = position, position + legs.feet
        deviations = np.full(STATES, self._parameters.leg_noise)
        deviations[[VELOCITY, BIAS]] = 0.02, self._parameters.first_bias
        covariance = np.array([np.diag(deviations**2)] * 2)
        placed = np.array([POSITION, *_FEET])
        covariance[PLANE][np.ix_(placed, placed)] += spread**2
        return Belief(mean, covariance, rotation)

    def predict(
        self,
        belief: Belief,
        dt: float,
        rotation: Array,
        force: Array,
        legs: LegMotion,
        trust: Array,
    ) -> Belief:
        """Return what is known a time later.

        Args:
            belief: Before.
            dt: Time to go on by [s].
            rotation: Base frame to world then, (3, 3).
            force: Specific force in between, base frame [m/s^2], (3,).
            legs: How they move.
            trust: How much each foot is believed to stand, from 0 to 1, (4,).
        """
        p, before, mean = self._parameters, belief.mean, belief.mean.copy()
        blind = dt > p.longest_gap
        mean[BIAS] = bias = rotation @ (before[BIAS] @ belief.rotation)
        acceleration = (not blind) * (rotation @ force + _GRAVITY - bias)
        mean[POSITION] += dt * before[VELOCITY] + (0.5 * dt * dt) * acceleration
        mean[VELOCITY] += dt * acceleration
        mean[FEET] += dt * legs.rolling
        transition = self._identity.copy()
        transition[POSITION, VELOCITY] = dt
        transition[POSITION, BIAS], transition[VELOCITY, BIAS] = -0.5 * dt * dt, -dt
        covariance = transition @ belief.covariance @ transition.T
        noise = np.zeros(STATES)
        noise[VELOCITY] = dt * p.acceleration_noise**2 + blind * (dt * _UNKNOWN) ** 2
        noise[BIAS] = dt * p.bias_drift**2
        stands = trust * (not blind)
        noise[FEET] = dt * (stands * p.foot_drift**2 + (1.0 - stands) * _FREE**2)
        covariance += np.diag(noise)
        return Belief(mean, covariance, rotation)

    def correct(self, belief: Belief, legs: LegMotion, trust: Array, still: bool) -> Belief:
        """Return what is known after the legs were looked at.

        Information form: P^-1 and P^-1 x grow by H^T R^-1 H and H^T R^-1 z.

        Args:
            belief: Before.
            legs: How they move.
            trust: How much each foot is believed to stand, from 0 to 1, (4,).
            still: Whether the base is known to rest, whatever the feet do.
        """
        mean = belief.mean
        information = self._legs.copy()
        information[:, VELOCITY, VELOCITY] = self._speed * (trust.sum() + still)
        information[VERTICAL, _FEET, _FEET] += self._ground * trust
        seen = self._foot * (legs.feet - mean[FEET] + mean[POSITION])
        news = np.zeros((STATES, 3))
        news[POSITION] = -seen.sum(axis=0)
        news[VELOCITY] = -self._speed * (
            trust @ (legs.contact_velocity + mean[VELOCITY]) + still * mean[VELOCITY]
        )
        news[FEET] = seen
        news[FEET, 2] += self._ground * trust * (TOE_RADIUS - mean[FEET, 2])
        prior = belief.covariance
        posterior = np.linalg.solve(self._identity + prior @ information, prior)
        covariance = 0.5 * (posterior + posterior.transpose(0, 2, 1))
        change = np.empty((STATES, 3))
        change[:, :2], change[:, 2] = (
            covariance[PLANE] @ news[:, :2],
            covariance[VERTICAL] @ news[:, 2],
        )
        return Belief(mean + change, covariance, belief.rotation)

    def shift(self, belief: Belief, error: Array, noise: float, limit: float) -> Belief:
        """Return what is known after the position in the plane was seen from outside.

        The correction is no longer than a limit: if it were, the sighting counts as so
        much worse, in mean and covariance.

        Args:
            belief: Before.
            error: How far it was seen from where it is believed to be [m], (2,).
            noise: Standard deviation of each coordinate [m].
            limit: Longest correction [m].
        """
        column = belief.covariance[PLANE, :, POSITION]
        known = float(column[POSITION])
        spread = max(known + noise**2, known * float(np.hypot(*error)) / limit)
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        mean[:, :2] += np.outer(column / spread, error)
        covariance[PLANE] -= np.outer(column, column) / spread
        return replace(belief, mean=mean, covariance=covariance)

    def turn(self, belief: Belief, angle: float) -> Belief:
        """Return the belief of a robot that was turned where it stands, about the vertical [rad].

        Velocity, bias and feet turn with the body: only the heading was wrong.
        """
        cos, sin = np.cos(angle), np.sin(angle)
        about = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        position = belief.mean[POSITION]
        mean = belief.mean @ about.T
        mean[POSITION] = position
        mean[FEET] = position + (belief.mean[FEET] - position) @ about.T
        return replace(belief, mean=mean, rotation=about @ belief.rotation)
