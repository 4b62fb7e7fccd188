"""Streams a bag once and keeps what the checks need."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.audit.poses import Points, TrackStates, track_name
from layered_cbf_ros.bags.audit.trace import SeriesSource, Trace, TraceBuilder
from layered_cbf_ros.bags.run.base_states import Odometries, Velocities, base_states, is_odometry
from layered_cbf_ros.bags.run.series import (
    JointStates,
    JointTrajectories,
    PlannedMotions,
    Series,
)
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.health import TOLD_BY
from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.node_topics import (
    BARRIERS,
    DESIRED,
    DETECTIONS,
    DIAGNOSTICS,
    PLAN,
    SCENARIO,
    STATE,
    TRACKED,
    TRACKS,
    TRUTH,
    cmd_vel_safe,
    odometry,
)
from layered_cbf_ros.scenario import BASES, Scenario
from layered_cbf_ros.scenario_file import from_json

COMMANDS, FORCES = 'joint_commands', 'ground_forces'
SOURCES: dict[str, Callable[[], SeriesSource]] = {
    STATE: JointStates,
    PLAN: PlannedMotions,
    BARRIERS: JointTrajectories,
    DESIRED: JointTrajectories,
    TRUTH: Points,
    DETECTIONS: Points,
    TRACKED: Points,
    TRACKS: TrackStates,
}


class Efforts(JointStates):
    """sensor_msgs/JointState without positions; fields are velocity and effort."""

    def build(self) -> Series | None:
        """Return all that was taken, None if it was nothing."""
        series = super().build()
        if series is None:
            return None
        return dataclasses.replace(series, values=series.values[:, 1:].copy())


@dataclass(frozen=True)
class Evidence:
    """What a bag tells of one run.

    Attributes:
        path: The bag.
        truncated: True if it ends before its end.
        counts: Messages by topic.
        notes: The recorder's own notes, see Bag.notes.
        unreadable: Messages that couldn't be decoded, by topic.
        scenario: What was run, or None.
        traces: By topic; those of TRACKS by topic and track, `<topic> <name>`. Of bases,
            STATE is put together from their odometry.
        diagnostics: Last key-values by node.
    """

    path: Path
    truncated: bool
    counts: Mapping[str, int]
    notes: Mapping[str, Mapping[str, str]]
    unreadable: Mapping[str, int]
    scenario: Scenario | None
    traces: Mapping[str, Trace]
    diagnostics: Mapping[str, Mapping[str, str]]

    @property
    def has_bases(self) -> bool:
        """Tell whether the robots have their own locomotion."""
        return self.scenario is not None and self.scenario.plant == BASES

    @property
    def robots(self) -> list[str]:
        """Return the robots of the scenario, without one those in the states."""
        if self.scenario is not None:
            return [robot.name for robot in self.scenario.robots]
        state = self.traces.get(STATE)
        names = () if state is None else state.series.names
        return [name.split('/')[0] for name in names if name.endswith('/base_x')]

    @property
    def start_ns(self) -> int:
        """Return the stamp of the first state, from which times are counted [ns]."""
        state = self.traces.get(STATE)
        return 0 if state is None else int(state.series.stamps_ns[0])

    def seconds(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Return stamps as seconds since the first state [s]."""
        return (stamps_ns - self.start_ns) / NS_PER_S

    def tracks(self) -> dict[str, Trace]:
        """Return the traces of the tracks, by the name of the track."""
        head = f'{TRACKS} '
        return {
            topic[len(head) :]: trace
            for topic, trace in self.traces.items()
            if topic.startswith(head)
        }


@dataclass
class _Gatherer:
    """Takes the messages of one bag, topic by topic."""

    traces: dict[str, TraceBuilder] = field(default_factory=dict)
    unreadable: dict[str, int] = field(default_factory=dict)
    scenario: Scenario | None = None
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)
    decoder: MessageDecoder = field(default_factory=MessageDecoder)

    def take(self, record: Record) -> None:
        """Take one message; count it if it can't be decoded."""
        topic = record.topic.name
        try:
            if topic == SCENARIO:
                self.scenario = from_json(self.decoder.decode(record).data)
            elif topic == DIAGNOSTICS:
                for status in self.decoder.decode(record).status:
                    values = {entry.key: entry.value for entry in status.values}
                    if not values.get(TOLD_BY):  # else it is another's word on a silent node
                        self.diagnostics[status.name] = values
            else:
                key = f'{topic} {track_name(record.data)}' if topic == TRACKS else topic
                self._trace(key, topic).take(record)
        except (LayeredCbfError, json.JSONDecodeError):
            self.unreadable[topic] = self.unreadable.get(topic, 0) + 1

    def _trace(self, key: str, topic: str) -> TraceBuilder:
        if key not in self.traces:
            self.traces[key] = TraceBuilder(key, _source(topic))
        return self.traces[key]


def is_audited(topic: str, bases: bool) -> bool:
    """Tell whether the audit needs a topic; those of bases only where there are any."""
    named = topic in (*SOURCES, SCENARIO, DIAGNOSTICS)
    of_base = bases and (is_odometry(topic) or _is_velocity(topic))
    return named or of_base or topic.rpartition('/')[2] in (COMMANDS, FORCES)


def _is_velocity(topic: str) -> bool:
    return topic == cmd_vel_safe(topic.strip('/').rpartition('/')[0])


def _source(topic: str) -> Callable[[], SeriesSource]:
    """Return what decodes a topic."""
    if is_odometry(topic):
        return Odometries
    return Velocities if _is_velocity(topic) else SOURCES.get(topic, Efforts)


def gather(bag: Bag) -> Evidence:
    """Read a bag.

    Raises:
        BagError: If it can't be read.
    """
    gatherer = _Gatherer()
    for record in bag.records():  # to ask for the topics first would be a second pass
        if is_audited(record.topic.name, bases=True):
            gatherer.take(record)
    # The states first: the memory that their parts leave behind serves all the others.
    keys = sorted(gatherer.traces, key=lambda key: key != STATE)
    built = {key: gatherer.traces.pop(key).build() for key in keys}
    traces = {key: trace for key, trace in built.items() if trace is not None}
    scenario = gatherer.scenario
    if scenario is not None and scenario.plant == BASES:
        traces |= _states_of_bases(traces, scenario)
    else:
        traces = {key: it for key, it in traces.items() if not is_odometry(key)}
    return Evidence(
        path=bag.path,
        truncated=bag.truncated,
        counts=dict(bag.counts),
        notes=dict(bag.notes),
        unreadable=gatherer.unreadable,
        scenario=scenario,
        traces=traces,
        diagnostics=gatherer.diagnostics,
    )


def _states_of_bases(traces: Mapping[str, Trace], scenario: Scenario) -> dict[str, Trace]:
    """Return what stands for STATE; the last base's messages tell when it was sent."""
    told = {key: trace.series for key, trace in traces.items() if is_odometry(key)}
    series = base_states(told, scenario)
    last = traces.get(odometry(scenario.robots[-1].name))
    if series is None or last is None:
        return {}
    return {STATE: Trace(STATE, series, last.stamps_ns, last.sent_ns, last.logged_ns, 0, (), ())}
