"""What re-solving found, as values that can be printed, written as JSON, or sent on."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from layered_cbf_ros.bags.json_output import finite
from layered_cbf_ros.bags.resolving.comparison import Comparison
from layered_cbf_ros.bags.resolving.plan_measures import Extreme, PlanFigures


@dataclass(frozen=True)
class QuantityResult:
    """How far one quantity is off.

    Attributes:
        quantity, unit: What it is.
        different: Numbers that aren't the same to the bit.
        mean, rms: Mean |d| and root mean d^2 over all that was compared.
        largest: Largest |d|; infinite where only one of the two is a number.
        name, stamp_ns: Where the largest is.
    """

    quantity: str
    unit: str
    different: int
    mean: float
    rms: float
    largest: float
    name: str
    stamp_ns: int | None


@dataclass(frozen=True)
class TopicResult:
    """One topic, recorded and re-solved; a row is what a message tells at one stamp.

    Attributes:
        topic: Its name.
        in_bag: False if it wasn't recorded at all.
        compared, bit_equal: Rows.
        recorded_only, resolved_only: Rows that lack their partner.
        unpaired_within: Those of them between the first and the last compared one.
        repeated: Rows that were sent again.
        other_names: Rows that don't name the same things.
        first_different_ns: First stamp with a difference [ns].
        quantities: Those that differ, the worst of each unit somewhere among them.
    """

    topic: str
    in_bag: bool = False
    compared: int = 0
    bit_equal: int = 0
    recorded_only: int = 0
    resolved_only: int = 0
    unpaired_within: int = 0
    repeated: int = 0
    other_names: int = 0
    first_different_ns: int | None = None
    quantities: tuple[QuantityResult, ...] = ()

    @property
    def is_equal(self) -> bool:
        """Tell whether all that can be compared is the same, with nothing missing between."""
        return self.compared == self.bit_equal and not self.unpaired_within


@dataclass(frozen=True)
class PlanAnswer:
    """The recorded plan, and the one that other gains, or none, would have made.

    Attributes:
        recorded, resolved: Their figures; None where there is no plan.
        apart: The largest distance between the two [m]; its time is a stamp [s].
    """

    recorded: PlanFigures | None
    resolved: PlanFigures | None
    apart: Extreme | None


@dataclass(frozen=True)
class NodeResult:
    """One node.

    Attributes:
        node: Its name.
        changes: Parameters that differ from the recorded ones: old and new.
        ticks: Ticks that were computed.
        duration_s: Time between the first and the last of them [s].
        skipped: Ticks whose inputs the bag doesn't hold.
        refused: Inputs that were refused, as in the run.
        from_start: False if what it remembered at the first tick isn't known.
        solver_failures: Of the re-solved ticks.
        recorded_failures: Of the run, None if it isn't told.
        topics: Its outputs.
        plan: What the coordinator's plan was good for, if that was asked.
    """

    node: str
    changes: dict[str, tuple[Any, Any]]
    ticks: int
    duration_s: float
    skipped: int
    refused: int
    from_start: bool
    solver_failures: int
    recorded_failures: int | None
    topics: tuple[TopicResult, ...]
    plan: PlanAnswer | None = None


@dataclass(frozen=True)
class ResolveResult:
    """All nodes.

    Attributes:
        bag, scenario: What was re-solved.
        time: 'lockstep' or 'real_time'.
        truncated: The bag ends before its end.
        filtered: False if the coordinator's filter was off.
        what_if: Whether something was asked to be otherwise than in the run.
        wall_time_s, recorded_time_s: How long it took, and how long the ticks last [s].
        nodes: The nodes.
    """

    bag: str
    scenario: str
    time: str
    truncated: bool
    filtered: bool
    what_if: bool
    wall_time_s: float
    recorded_time_s: float
    nodes: tuple[NodeResult, ...]

    @property
    def is_equal(self) -> bool:
        """Tell whether every output is the same to the bit."""
        return all(topic.is_equal for node in self.nodes for topic in node.topics)

    @property
    def compared(self) -> int:
        """Return the number of compared rows."""
        return sum(topic.compared for node in self.nodes for topic in node.topics)

    @property
    def overlaps(self) -> int:
        """Return how often bodies overlap in a re-solved plan."""
        plans = [node.plan.resolved for node in self.nodes if node.plan]
        return sum(len(plan.overlaps) for plan in plans if plan)

    def to_json(self) -> dict[str, Any]:
        """Return everything in the form of JSON; what is not a finite number is null."""
        form: dict[str, Any] = finite(
            {**dataclasses.asdict(self), 'compared': self.compared, 'bit_equal': self.is_equal}
        )
        return form


def topic_result(comparison: Comparison) -> TopicResult:
    """Return what a comparison found."""
    quantities = []
    for (name, unit), deviation in comparison.deviations.items():
        mean, rms = comparison.mean_and_rms((name, unit))
        where = deviation.largest, deviation.name, deviation.stamp_ns
        quantities.append(QuantityResult(name, unit, deviation.count, mean, rms, *where))
    return TopicResult(
        topic=comparison.topic,
        in_bag=True,
        compared=comparison.compared,
        bit_equal=comparison.bit_equal,
        recorded_only=len(comparison.recorded_only),
        resolved_only=len(comparison.resolved_only),
        unpaired_within=comparison.unpaired_within,
        repeated=comparison.repeated,
        other_names=comparison.other_names,
        first_different_ns=comparison.first_different_ns,
        quantities=tuple(quantities),
    )
