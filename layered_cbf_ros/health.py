"""How well a node is: a level and words, from what it counted and what holds now.

Levels go by news: a message that was refused an hour ago is still counted, but the node is
well again. What is over is told for a few seconds more, as a warning, so that whoever
looks once a second, or once, sees it.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields

from layered_cbf_ros.interfaces import NS_PER_S

HOLD_NS = 5 * NS_PER_S
"""How long something that is over is still told: some looks of a person [ns]."""
WAIT_S = 2.0
"""A wait that is longer is told: states come each millisecond, partners within a second [s]."""
FAILING = 0.5
"""Share of ticks: beyond it a node does without more often than it does its job."""
LATE = 0.01
"""Share of missed ticks that is told: single ones are bridged by holding the last command, and
no system without real-time scheduling is free of them."""
TOLD_BY = 'told_by'
"""Key of a status that somebody else tells: who. Its figures are the last known ones."""


class Level(enum.IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus; the greater the worse."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Report:
    """What is told of one node, once a second.

    Attributes:
        name: Full name of the node; by it an aggregator sorts.
        level: How well it is.
        message: What a person should know.
        values: Its figures.
        hardware_id: The robot it belongs to, or the host.
    """

    name: str
    level: Level
    message: str
    values: Mapping[str, str]
    hardware_id: str = ''


@dataclass(frozen=True, slots=True)
class Counts:
    """What a node has counted since its start."""

    ticks: int = 0
    deadline_misses: int = 0
    solver_failures: int = 0
    slack_events: int = 0
    without_input: int = 0
    rejected: int = 0
    lost: int = 0

    def since(self, before: Counts) -> Counts:
        """Return what was counted since an earlier moment."""
        return Counts(*(getattr(self, name) - getattr(before, name) for name in COUNTERS))


COUNTERS = tuple(counter.name for counter in fields(Counts))


@dataclass(frozen=True, slots=True)
class Situation:
    """What holds at this moment.

    Attributes:
        real_time: Whether ticks have deadlines.
        waiting_for, waited: Whom or what the node waits for, and for how long already [s].
        idle: Whether it waits for its next tick, not for what a tick needs.
        last_rejected, last_missing: The newest reason to refuse a message, the input that
            was missing last.
        details: What only this kind of node tells.
        faults: What it knows itself to be wrong.
    """

    real_time: bool = False
    waiting_for: str = ''
    waited: float = 0.0
    idle: bool = False
    last_rejected: str = ''
    last_missing: str = ''
    details: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        cause: Its kind; of each kind the newest is told.
        level: How bad it is.
        text: What a person reads.
    """

    cause: str
    level: Level
    text: str


@dataclass(frozen=True, slots=True)
class Remembered:
    """A fault, and when it was there last [ns]."""

    fault: Fault
    seen_ns: int


def faults_of(news: Counts, now: Situation) -> tuple[Fault, ...]:
    """Return what is wrong.

    Args:
        news: What was counted since the last report.
        now: What holds at this moment.
    """
    return (*_counted(news, now), *_lasting(now), *now.faults)


def _counted(news: Counts, now: Situation) -> Iterator[Fault]:
    ticks = max(1, news.ticks)
    if news.solver_failures:
        level = Level.ERROR if news.solver_failures > FAILING * ticks else Level.WARN
        yield Fault('solver', level, f'solver failed in {news.solver_failures} of {ticks} ticks')
    if news.without_input:
        level = Level.ERROR if news.without_input > FAILING * ticks else Level.WARN
        text = f'nothing of {now.last_missing} in {news.without_input} of {ticks} ticks'
        yield Fault('input', level, text)
    if now.real_time and news.deadline_misses > LATE * ticks:
        yield Fault('late', Level.WARN, f'{news.deadline_misses} deadlines missed')
    if news.slack_events:
        yield Fault('slack', Level.WARN, f'slack in {news.slack_events} of {ticks} ticks')
    if news.rejected:
        reason = f': {now.last_rejected}' if now.last_rejected else ''
        yield Fault('rejected', Level.WARN, f'{news.rejected} rejected{reason}')
    if news.lost:
        yield Fault('lost', Level.WARN, f'{news.lost} messages lost')


def _lasting(now: Situation) -> Iterator[Fault]:
    """Yield what is wrong as long as it lasts.

    A latched emergency stop is an error, though somebody meant it: the team doesn't do its
    job, and won't, until a person resets it. As a warning it would drown among refused
    messages, and a script that asks whether a mission may begin would hear yes.

    Whoever waits for its next tick in lockstep is only idle: the plant keeps the time, may be
    paused, and itself says whom it waits for. In real time the robot's state is missing.
    """
    details = now.details
    if details.get('e_stop'):
        yield Fault('e_stop', Level.ERROR, f'emergency stop {details["e_stop"]}')
    if details.get('frozen'):
        yield Fault('frozen', Level.ERROR, f'frozen: {details["frozen"]}')
    if details.get('tracks_left_out', '0') not in ('', '0'):
        yield Fault('tracks', Level.WARN, f'{details["tracks_left_out"]} tracks left out')
    if now.waiting_for and now.waited > WAIT_S:
        if not now.idle:
            text = f'waits for {now.waiting_for} for {now.waited:.0f} s'
            yield Fault('waiting', Level.WARN, text)
        elif now.real_time:
            text = f'nothing on {now.waiting_for} for {now.waited:.0f} s'
            yield Fault('waiting', Level.ERROR, text)


def remember(
    memory: Sequence[Remembered], present: Sequence[Fault], now_ns: int
) -> tuple[Remembered, ...]:
    """Return all that is to be told: what is wrong now, and what was a moment ago.

    Args:
        memory: What was told the last time.
        present: What is wrong now.
        now_ns: Time [ns].
    """
    causes = {fault.cause for fault in present}
    over = (
        each
        for each in memory
        if each.fault.cause not in causes and now_ns - each.seen_ns <= HOLD_NS
    )
    return (*(Remembered(fault, now_ns) for fault in present), *over)


def verdict(memory: Sequence[Remembered], now_ns: int) -> tuple[Level, str]:
    """Return the worst level, and all faults in words, the worst first."""
    told = []
    for each in memory:
        level, text, age_ns = each.fault.level, each.fault.text, now_ns - each.seen_ns
        if age_ns:
            level, text = min(level, Level.WARN), f'{age_ns / NS_PER_S:.0f} s ago: {text}'
        told.append((level, text))
    told.sort(key=lambda each: -each[0])
    return (told[0][0] if told else Level.OK), '; '.join(text for _, text in told)


def worst(reports: Sequence[Report]) -> Level:
    """Return the level of a graph: an error if somebody is stale, for nobody knows how he is."""
    return min(Level.ERROR, max((report.level for report in reports), default=Level.OK))
