"""What a check finds: its worst value, its breaches, and what it could not prove."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.interfaces import Array

OK, BREACH, NOT_PROVEN = 'ok', 'BREACH', 'NOT PROVEN'


@dataclass(frozen=True, slots=True)
class Breach:
    """One interval of samples in a row that break a limit.

    Attributes:
        subject: The pair, robot, joint or topic.
        start_s, end_s: First and last of these samples, since the first state [s].
        value, limit: The worst value, and what it should have kept [unit of the check].
        samples: How many samples.
    """

    subject: str
    start_s: float
    end_s: float
    value: float
    limit: float
    samples: int


@dataclass(frozen=True, slots=True)
class Worst:
    """The value of one subject with the least margin to its limit.

    Attributes:
        subject: The pair, robot, joint or topic.
        time_s: When, since the first state [s].
        value, limit: [unit of the check].
        margin: What is left between them, negative in a breach.
    """

    subject: str
    time_s: float
    value: float
    limit: float
    margin: float


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the table.

    Attributes:
        name: What is checked.
        unit: Of values and limits.
        relation: '<=', '>=' or '>': what values must be to their limit; '' for a
            figure that is only told.
        breaches: Intervals in which they were not.
        holes: Sentences that tell what was not proven.
        notes: Sentences that a reader should know.
        worsts: The worst value of each subject.
    """

    name: str
    unit: str
    relation: str
    breaches: tuple[Breach, ...] = ()
    holes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    worsts: tuple[Worst, ...] = ()

    @property
    def worst(self) -> Worst | None:
        """Return the value with the least margin of all."""
        return min(self.worsts, key=lambda worst: worst.margin, default=None)

    @property
    def status(self) -> str:
        """Return OK, BREACH or NOT_PROVEN; a breach stays one beside a hole."""
        if self.breaches:
            return BREACH
        return NOT_PROVEN if self.holes else OK


@dataclass(frozen=True, slots=True)
class Samples:
    """Values of one subject over time.

    Attributes:
        subject: The pair, robot, joint or topic.
        times: Since the first state, increasing [s], (k,).
        values: (k,).
        limit: What they must keep.
    """

    subject: str
    times: Array
    values: Array
    limit: float


def at_most(
    name: str,
    unit: str,
    samples: Iterable[Samples],
    holes: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> Check:
    """Check that values do not exceed their limits."""
    return _judged(name, unit, '<=', samples, holes, notes)


def at_least(
    name: str,
    unit: str,
    samples: Iterable[Samples],
    holes: Sequence[str] = (),
    notes: Sequence[str] = (),
    relation: str = '>=',
) -> Check:
    """Check that values do not fall below their limits; relation '>' forbids equality."""
    return _judged(name, unit, relation, samples, holes, notes)


def told(name: str, unit: str, samples: Iterable[Samples]) -> Check:
    """Return the largest value as a figure that is not judged."""
    return _judged(name, unit, '', samples, (), ())


def not_proven(name: str, *holes: str) -> Check:
    """Return a check for which the bag has nothing."""
    return Check(name, '', '', holes=holes)


def _judged(
    name: str,
    unit: str,
    relation: str,
    samples: Iterable[Samples],
    holes: Sequence[str],
    notes: Sequence[str],
) -> Check:
    sign = -1.0 if relation.startswith('>') else 1.0
    breaches: list[Breach] = []
    worsts, found = [], list(holes)
    for part in samples:
        finite = np.isfinite(part.values)
        if not finite.all():
            found.append(f'{part.subject}: {np.sum(~finite)} values are not finite')
        if not finite.any():
            continue
        excess = np.where(finite, sign * (part.values - part.limit), -np.inf)
        row = int(excess.argmax())
        time_s, value = float(part.times[row]), float(part.values[row])
        worsts.append(Worst(part.subject, time_s, value, part.limit, -float(excess[row])))
        if relation:
            breaches += _intervals(part, excess, excess >= 0.0 if relation == '>' else excess > 0.0)
    breaches.sort(key=lambda breach: (breach.start_s, breach.subject))
    return Check(
        name, unit, relation, tuple(breaches), tuple(found), tuple(notes), tuple(worsts)
    )  # fmt: skip


def _intervals(part: Samples, excess: Array, broken: NDArray[np.bool_]) -> list[Breach]:
    """Return runs of broken samples in a row, each with its worst value."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], broken, [False])).astype(np.int8)))
    breaches = []
    for begin, end in edges.reshape(-1, 2).tolist():
        worst = begin + int(excess[begin:end].argmax())
        start_s, end_s = float(part.times[begin]), float(part.times[end - 1])
        value = float(part.values[worst])
        breaches.append(Breach(part.subject, start_s, end_s, value, part.limit, end - begin))
    return breaches
