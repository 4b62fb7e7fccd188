"""Who listens while a bag is re-solved: to compare, to measure, to count."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from layered_cbf_ros.bags.resolving.comparison import Comparison
from layered_cbf_ros.bags.resolving.coordinator_core import CoordinatorCore
from layered_cbf_ros.bags.resolving.distances import Point
from layered_cbf_ros.bags.resolving.plan_measures import Extreme, PlanMeasures
from layered_cbf_ros.bags.resolving.rows import Content, Row, RowReader
from layered_cbf_ros.bags.resolving.ticks import Tick
from layered_cbf_ros.bags.run.node_health import NodeHealth
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import points_from
from layered_cbf_ros.node_topics import BARRIERS, DIAGNOSTICS, INTERVENTION, PLAN, TRACKS, TRUTH
from layered_cbf_ros.perception.known_tracks import track_radius
from layered_cbf_ros.scenario import Scenario

MEASURED = (PLAN, BARRIERS, INTERVENTION)


class Comparer:
    """Compares the answers with those that were recorded, topic by topic."""

    def __init__(self, outputs: Sequence[str], recorded: Sequence[str]) -> None:
        """Begin.

        Args:
            outputs: Topics that are re-solved.
            recorded: Topics of the bag.
        """
        self.comparisons = {topic: Comparison(topic) for topic in outputs if topic in recorded}
        self.topics = frozenset(self.comparisons)

    def recorded(self, record: Record) -> None:
        """Take a recorded answer."""
        self.comparisons[record.topic.name].take_recorded(record)

    def resolved(self, topic: str, content: Content, tick: Tick) -> None:
        """Take an answer of a core."""
        if topic in self.comparisons:
            self.comparisons[topic].take_resolved(content)


class HealthListener:
    """Hears what nodes told of themselves on /diagnostics."""

    topics = frozenset((DIAGNOSTICS,))

    def __init__(self) -> None:
        self._decoder = MessageDecoder()
        self._health = NodeHealth()

    def solver_failures(self, node: str) -> int | None:
        """Return the failures of a node and its restarts, None if it told nothing."""
        told = self._health.totals().get(f'/{node}')
        return None if told is None else told['solver_failures']

    def recorded(self, record: Record) -> None:
        """Take a diagnostic message."""
        self._health.add(self._decoder.decode(record), None)

    def resolved(self, topic: str, content: Content, tick: Tick) -> None:
        """Do nothing."""


class PlanWatch:
    """Measures the recorded plan and the re-solved one alike."""

    def __init__(
        self,
        scenario: Scenario,
        recorded: CoordinatorParameters,
        core: CoordinatorCore,
        bag_topics: Sequence[str],
    ) -> None:
        """Begin.

        Args:
            scenario: Of the run.
            recorded: The gains of the run.
            core: Whose answers are measured.
            bag_topics: Of the bag: obstacles are where the simulator says, or else where
                the tracker believed them.
        """
        self._scenario = scenario
        self._old = PlanMeasures(scenario, recorded)
        self._new = PlanMeasures(scenario, core.parameters)
        bodies = TRUTH if TRUTH in bag_topics else TRACKS
        self.topics = frozenset((*MEASURED, bodies))
        self._readers = {topic: RowReader(topic) for topic in (*MEASURED, TRACKS)}
        self._decoder = MessageDecoder()
        self._plans: tuple[dict[int, Row], dict[int, Row]] = ({}, {})
        self.apart: Extreme | None = None

    @property
    def measures(self) -> tuple[PlanMeasures, PlanMeasures]:
        """Return what was measured of the recorded and of the re-solved plan."""
        return self._old, self._new

    def recorded(self, record: Record) -> None:
        """Take what was recorded of the plan, or of the obstacles."""
        topic = record.topic.name
        if topic == TRUTH:
            self._take_truth(record)
            return
        for content in self._readers[topic].read(record):
            row = self._readers[topic].row(content)
            if topic == TRACKS:
                body = row.values[:2, 0].tolist(), track_radius(self._scenario)
                self._take_bodies(row.stamp_ns, {row.part: body})
            else:
                self._old.take(topic, row)
            if topic == PLAN:
                self._take_plan(row, *self._plans)

    def resolved(self, topic: str, content: Content, tick: Tick) -> None:
        """Take an answer of the core."""
        if topic in MEASURED:
            row = self._readers[topic].row(content)
            self._new.take(topic, row)
            if topic == PLAN:
                self._take_plan(row, *self._plans[::-1])

    def _take_truth(self, record: Record) -> None:
        places = points_from(self._decoder.decode(record)).tolist()
        bodies = {
            obstacle.name: (place, obstacle.radius)
            for obstacle, place in zip(self._scenario.obstacles, places, strict=False)
        }
        self._take_bodies(stamp_of(record.data), bodies)

    def _take_bodies(self, stamp_ns: int, bodies: Mapping[str, tuple[Point, float]]) -> None:
        for measures in self.measures:
            measures.others(stamp_ns, bodies)

    def _take_plan(self, row: Row, own: dict[int, Row], others: dict[int, Row]) -> None:
        """Compare the two plans once both are known at a stamp."""
        other = others.pop(row.stamp_ns, None)
        if other is None:
            own[row.stamp_ns] = row
            return
        for k, name in enumerate(row.names):
            distance = math.dist(row.values[:2, k], other.values[:2, k])
            if self.apart is None or distance > self.apart.value:
                self.apart = Extreme(distance, name, row.stamp_ns / NS_PER_S)
