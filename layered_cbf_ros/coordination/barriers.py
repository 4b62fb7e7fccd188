"""What every barrier gives to the planner: rows that are linear in the inputs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import Array

HARD = float('inf')


@dataclass(frozen=True, slots=True)
class Bodies:
    """Everybody who isn't an agent: K obstacles in the world frame.

    Attributes:
        names: Their names.
        position: Last known centres [m], (K, 2).
        velocity: Last known velocities [m/s], (K, 2).
        radius: Radii of the bodies [m], (K,).
        horizon: Time over which each set extends from its own stamp [s], (K,).
        growth: What each set is wider in every direction [m], (K,).
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array
    radius: Array
    horizon: Array
    growth: Array


@dataclass(frozen=True, slots=True)
class Scene:
    """What the barriers see at one tick; N agents, world frame.

    Attributes:
        position: Planned positions, measured for held agents [m], (N, 2).
        velocity: Planned velocities, measured for held agents [m/s], (N, 2).
        target: Desired velocities [m/s], (N, 2).
        held: Agents that can't obey an input and are mere bodies, (N,).
        any_held: Whether there are any.
        bodies: The obstacles.
    """

    position: Array
    velocity: Array
    target: Array
    held: NDArray[np.bool_]
    any_held: bool
    bodies: Bodies


@dataclass(frozen=True, slots=True)
class Rows:
    """M rows coefficients . u >= bound: the condition psi2 >= 0 (paper eq. (20)).

    psi0 = h, psi1 = psi0' + alpha1 psi0, psi2 = psi1' + alpha2 psi1
         = L_g psi1 u + L_f psi1 + alpha2 psi1 = coefficients . u - bound.

    Attributes:
        labels: What each row keeps apart, `one~other`.
        coefficients: L_g psi1, agent by agent, (M, N, 2).
        bound: -(L_f psi1 + alpha2 psi1) [m/s^2], (M,).
        psi0: Barrier [m], (M,).
        psi1: [m/s], (M,).
        centre: Centres q of the collision balls [m], (P, 2).
        radius: Their radii [m], (P,); P is M or, for a kind without balls, 0.
    """

    labels: tuple[str, ...]
    coefficients: Array
    bound: Array
    psi0: Array
    psi1: Array
    centre: Array
    radius: Array


class Barrier(Protocol):
    """One kind of safety condition.

    A new kind joins by one more class: the planner asks only for its rows, how many
    there are, and what breaking one costs.
    """

    @property
    def weight(self) -> float:
        """Return the linear penalty of a slack [s^2/m], or HARD."""
        ...

    def size(self, bodies: int) -> int:
        """Return the number of rows when there are so many bodies."""
        ...

    def rows(self, scene: Scene) -> Rows:
        """Return the rows at one tick."""
        ...


@dataclass(frozen=True, slots=True)
class Separation:
    """Geometry of M pairs (i, j).

    Attributes:
        direction: Unit vector n from i to j, (M, 2).
        distance: d [m], (M,).
        rate: d' = n . (v_j - v_i) [m/s], (M,).
        centrifugal: (|v_j - v_i|^2 - d'^2) / d [m/s^2], (M,): d'' without inputs.
    """

    direction: Array
    distance: Array
    rate: Array
    centrifugal: Array


def separation(
    position_i: Array, velocity_i: Array, position_j: Array, velocity_j: Array
) -> Separation:
    """Return direction, distance and its derivatives for each pair, (M, 2) each."""
    between = position_j - position_i
    relative = velocity_j - velocity_i
    distance = np.maximum(np.hypot(between[:, 0], between[:, 1]), 1e-9)
    direction = between / distance[:, None]
    rate = np.einsum('ij,ij->i', direction, relative)
    turning = np.einsum('ij,ij->i', relative, relative) - rate * rate
    return Separation(direction, distance, rate, turning / distance)


def high_order(
    psi0: Array, rate: Array, drift: Array, alpha1: float, alpha2: float
) -> tuple[Array, Array]:
    """Return psi1 and the bound of L_g psi1 u (paper eq. (16), linear alphas).

    The ball is carried by the object: its centre keeps its distance from j on the line
    of centres and its radius is frozen, so psi0' = d' and psi0'' = d''. Then
    psi1 = d' + alpha1 psi0 and psi2 = d'' + alpha1 d' + alpha2 psi1.

    Args:
        psi0: Barrier [m], (M,).
        rate: psi0' [m/s], (M,).
        drift: psi0'' without inputs [m/s^2], (M,).
        alpha1, alpha2: Decay rates [1/s].
    """
    psi1 = rate + alpha1 * psi0
    return psi1, -(drift + alpha1 * rate + alpha2 * psi1)


def no_rows(agents: int) -> Rows:
    """Return no rows at all, for so many agents."""
    none = np.zeros((0, agents, 2))
    flat = none[:, 0, 0]
    return Rows((), none, flat, flat, flat, none[:, 0], flat)


def stacked(groups: Sequence[Rows]) -> tuple[Rows, tuple[str, ...]]:
    """Return the rows of all barriers as one, and the labels of those with balls."""
    labels = tuple(itertools.chain.from_iterable(group.labels for group in groups))
    with_balls = (group.labels for group in groups if len(group.radius))
    return Rows(
        labels,
        np.concatenate([group.coefficients for group in groups]),
        np.concatenate([group.bound for group in groups]),
        np.concatenate([group.psi0 for group in groups]),
        np.concatenate([group.psi1 for group in groups]),
        np.concatenate([group.centre for group in groups]),
        np.concatenate([group.radius for group in groups]),
    ), tuple(itertools.chain.from_iterable(with_balls))
