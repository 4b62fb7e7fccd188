"""What a plan of the coordinator was good for, in figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from layered_cbf_ros.bags.resolving.distances import Approach, Distances, Overlap, Point
from layered_cbf_ros.bags.resolving.rows import Row
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import BARRIERS, INTERVENTION, PLAN
from layered_cbf_ros.scenario import Scenario

PSI0, PSI1, SLACK = 0, 1, 3


@dataclass(frozen=True)
class Extreme:
    """A smallest or largest value.

    Attributes:
        value: In the unit of its figure.
        name: Whose it is.
        at_s: When, since the start of the plan [s].
    """

    value: float
    name: str
    at_s: float


@dataclass(frozen=True)
class PlanFigures:
    """One plan in figures; None is what is not known.

    Attributes:
        duration_s: How long it is [s].
        goals_s: When each robot's plan first was within the goal's tolerance [s].
        approaches: Smallest distance of each pair.
        overlaps: Where bodies would have been closer than the sum of their radii.
        psi0, psi1: Smallest value of any row [m], [m/s].
        intervention: Largest |u - u_desired| [m/s^2].
        mean_intervention: Its mean over robots and ticks [m/s^2].
        slack_events: Ticks with a slack beyond the tolerance; None without barriers.
        solver_failures: Ticks without a solution.
        paths_m: Length of each robot's path [m].
    """

    duration_s: float
    goals_s: dict[str, float | None]
    approaches: dict[str, Approach]
    overlaps: tuple[Overlap, ...]
    psi0: Extreme | None
    psi1: Extreme | None
    intervention: Extreme | None
    mean_intervention: float | None
    slack_events: int | None
    solver_failures: int | None
    paths_m: dict[str, float]


@dataclass
class PlanMeasures:
    """Gathers the figures of one plan, tick by tick.

    Attributes:
        scenario: Who wants where.
        parameters: Radius of the robots, and what counts as a slack.
    """

    scenario: Scenario
    parameters: CoordinatorParameters
    _last_ns: dict[str, int] = field(default_factory=dict)
    _begin_ns: int | None = None
    _places: list[Point] = field(default_factory=list)
    _extremes: dict[str, Extreme] = field(default_factory=dict)
    _interventions: tuple[float, int] = (0.0, 0)
    _slack_events: int = 0

    def __post_init__(self) -> None:
        """Begin with nothing."""
        robots = [robot.name for robot in self.scenario.robots]
        self._goals = {r.name: r.desired.goal for r in self.scenario.robots}
        self._reached: dict[str, float | None] = {
            name: None for name, goal in self._goals.items() if goal is not None
        }
        self._paths = dict.fromkeys(robots, 0.0)
        self._distances = Distances(robots, self.parameters.agent_radius, self.scenario.walls)

    def take(self, topic: str, row: Row) -> None:
        """Take what a topic of the coordinator tells at a stamp; a repetition doesn't count."""
        if row.stamp_ns <= self._last_ns.get(topic, -1):
            return
        self._last_ns[topic] = row.stamp_ns
        if self._begin_ns is None:
            self._begin_ns = row.stamp_ns
        at_s = (row.stamp_ns - self._begin_ns) / NS_PER_S
        if topic == PLAN:
            self._take_plan(row, at_s)
        elif topic == BARRIERS:
            self._take_smallest('psi0', row, PSI0, at_s)
            self._take_smallest('psi1', row, PSI1, at_s)
            self._slack_events += bool(row.values[SLACK].max() > self.parameters.slack_tolerance)
        elif topic == INTERVENTION:
            total, count = self._interventions
            self._interventions = total + float(row.values[0].sum()), count + len(row.names)
            worst = int(row.values[0].argmax())
            value = float(row.values[0, worst])
            if 'u' not in self._extremes or value > self._extremes['u'].value:
                self._extremes['u'] = Extreme(value, row.names[worst], at_s)

    def others(self, stamp_ns: int, bodies: Mapping[str, tuple[Point, float]]) -> None:
        """Take where everybody else is: position and radius [m], by name."""
        self._distances.others(stamp_ns, bodies)

    def figures(self, solver_failures: int | None) -> PlanFigures | None:
        """Return the figures, None without a plan; the failures are counted by others."""
        if PLAN not in self._last_ns:
            return None
        total, count = self._interventions
        begin_ns = self._begin_ns or 0
        return PlanFigures(
            duration_s=(self._last_ns[PLAN] - begin_ns) / NS_PER_S,
            goals_s=dict(self._reached),
            approaches=dict(self._distances.approaches),
            overlaps=tuple(self._distances.overlaps),
            psi0=self._extremes.get('psi0'),
            psi1=self._extremes.get('psi1'),
            intervention=self._extremes.get('u'),
            mean_intervention=total / count if count else None,
            slack_events=self._slack_events if BARRIERS in self._last_ns else None,
            solver_failures=solver_failures,
            paths_m=dict(self._paths),
        )

    def _take_plan(self, row: Row, at_s: float) -> None:
        places = row.values[:2].T.tolist()
        for k, name in enumerate(row.names):
            if self._places:
                self._paths[name] += math.dist(places[k], self._places[k])
            goal = self._goals[name]
            if goal is None or self._reached[name] is not None:
                continue
            if math.dist(places[k], goal) <= self.scenario.goal_tolerance:
                self._reached[name] = at_s
        self._places = places
        self._distances.plan(row.stamp_ns, places)

    def _take_smallest(self, what: str, row: Row, index: int, at_s: float) -> None:
        least = int(row.values[index].argmin())
        value = float(row.values[index, least])
        if what not in self._extremes or value < self._extremes[what].value:
            self._extremes[what] = Extreme(value, row.names[least], at_s)
