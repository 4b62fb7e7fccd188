"""Re-solves the nodes of a run, in as many processes as there are processors to spare."""

from __future__ import annotations

import dataclasses
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from layered_cbf_ros.bags.resolving.coordinator_core import CoordinatorCore
from layered_cbf_ros.bags.resolving.cores import Core, ForceCore, TorqueCore, TrackerCore
from layered_cbf_ros.bags.resolving.listeners import Comparer, HealthListener, PlanWatch
from layered_cbf_ros.bags.resolving.recorded_orders import RecordedOrders
from layered_cbf_ros.bags.resolving.replaying import Listener, resolve
from layered_cbf_ros.bags.resolving.results import (
    NodeResult,
    PlanAnswer,
    TopicResult,
    topic_result,
)
from layered_cbf_ros.bags.resolving.run_setup import RunSetup
from layered_cbf_ros.bags.resolving.seats import Seat, seat_of
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import NS_PER_S

COST = {
    'coordinator': 5,
    'whole_body_controller': 4,
    'ground_force_mpc': 3,
    'obstacle_tracker': 2,
}
"""What a node's ticks cost per second of a run, roughly, for an even share."""


@dataclass(frozen=True)
class Question:
    """What is asked.

    Attributes:
        bag: Where the run is recorded.
        setup: How it was set up, with other parameters in it if that is asked.
        what_if: Whether the robots follow another plan than in the run.
        filtered: False for the coordinator's desired motion alone.
    """

    bag: Path
    setup: RunSetup
    what_if: bool = False
    filtered: bool = True


@dataclass(frozen=True)
class Findings:
    """What was found.

    Attributes:
        nodes: Of each node.
        truncated: The bag ends before its end, or is spoilt.
    """

    nodes: tuple[NodeResult, ...]
    truncated: bool


def resolved_nodes(
    question: Question, nodes: Sequence[str], jobs: int, extra: Sequence[Listener] = ()
) -> Findings:
    """Return what was found of each node, in their order.

    Args:
        question: What is asked.
        nodes: Those that are re-solved; they don't depend on each other.
        jobs: Processes at most.
        extra: More listeners; then there is one process.

    Raises:
        BagError: If the bag doesn't hold what a node needs.
    """
    shares = shared_out(nodes, 1 if extra else jobs)
    if len(shares) == 1:
        parts = [resolved_in_one_pass(question, shares[0], extra)]
    else:
        with ProcessPoolExecutor(len(shares), multiprocessing.get_context('fork')) as pool:
            parts = list(pool.map(partial(resolved_in_one_pass, question), shares))
    by_name = {result.node: result for part in parts for result in part.nodes}
    return Findings(tuple(by_name[n] for n in nodes), any(part.truncated for part in parts))


def shared_out(nodes: Sequence[str], jobs: int) -> list[list[str]]:
    """Return shares of nodes that cost about the same."""
    shares: list[list[str]] = [[] for _ in range(max(1, min(jobs, len(nodes))))]
    costs = [0] * len(shares)
    for node in sorted(nodes, key=lambda name: -_cost(name)):
        least = costs.index(min(costs))
        shares[least].append(node)
        costs[least] += _cost(node)
    return shares


def resolved_in_one_pass(
    question: Question, nodes: Sequence[str], extra: Sequence[Listener] = ()
) -> Findings:
    """Re-solve some nodes while the bag is read once; see resolved_nodes."""
    bag = open_bag(question.bag)
    cores = [core_of(question, node) for node in nodes]
    comparer = Comparer([topic for core in cores for topic in core.outputs], list(bag.topics))
    health = HealthListener()
    watches = {
        core.node: _watch(question.setup, core, list(bag.topics))
        for core in cores
        if question.what_if and isinstance(core, CoordinatorCore)
    }
    seats = [seat_of(core, question.setup.scenario) for core in cores]
    resolve(bag, seats, [comparer, health, *watches.values(), *extra])
    found = (
        _result(question, seat, comparer, health, watches.get(seat.core.node)) for seat in seats
    )
    return Findings(tuple(found), bag.truncated)


def core_of(question: Question, node: str) -> Core:
    """Return the core of a node."""
    kind = node.rpartition('/')[2]
    if kind == 'coordinator':
        orders = RecordedOrders(open_bag(question.bag), question.setup.robots)
        return CoordinatorCore(question.setup, node, orders, question.filtered, question.what_if)
    if kind == 'ground_force_mpc':
        return ForceCore(question.setup, node)
    if kind == 'whole_body_controller':
        return TorqueCore(question.setup, node)
    return TrackerCore(question.setup, node)


def without_changes(setup: RunSetup) -> RunSetup:
    """Return the setup as it was recorded."""
    return dataclasses.replace(setup, changes={})


def _watch(setup: RunSetup, core: CoordinatorCore, topics: Sequence[str]) -> PlanWatch:
    recorded = without_changes(setup).parameters(core.node, CoordinatorParameters)
    return PlanWatch(setup.scenario, recorded, core, topics)


def _result(
    question: Question,
    seat: Seat,
    comparer: Comparer,
    health: HealthListener,
    watch: PlanWatch | None,
) -> NodeResult:
    core, tally = seat.core, seat.core.tally
    recorded_failures = health.solver_failures(core.node)
    topics = tuple(
        topic_result(comparer.comparisons[topic])
        if topic in comparer.comparisons
        else TopicResult(topic)
        for topic in core.outputs
    )
    plan = None
    if watch is not None:
        old, new = watch.measures
        plan = PlanAnswer(
            old.figures(recorded_failures), new.figures(tally.solver_failures), watch.apart
        )
    return NodeResult(
        node=core.node,
        changes=_changes(question.setup, core.node),
        ticks=tally.ticks,
        duration_s=(tally.last_ns - tally.first_ns) / NS_PER_S,
        skipped=seat.skipped,
        refused=tally.refused,
        from_start=seat.from_start,
        solver_failures=tally.solver_failures,
        recorded_failures=recorded_failures,
        topics=topics,
        plan=plan,
    )


def _changes(setup: RunSetup, node: str) -> dict[str, tuple[Any, Any]]:
    """Return the parameters that differ from the recorded ones: old and new."""
    recorded = setup.scenario.parameters.get(node.rpartition('/')[2], {})
    return {
        name: (recorded.get(name), value)
        for name, value in setup.changes.get(node, {}).items()
        if recorded.get(name) != value
    }


def _cost(node: str) -> int:
    return COST[node.rpartition('/')[2]]
