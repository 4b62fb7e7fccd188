"""A recorded plan and a re-solved one side by side, as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from layered_cbf_ros.bags.resolving.distances import Approach, Overlap
from layered_cbf_ros.bags.resolving.plan_measures import Extreme, PlanFigures
from layered_cbf_ros.bags.resolving.results import PlanAnswer
from layered_cbf_ros.bags.tables import aligned


def plan_lines(answer: PlanAnswer) -> Iterator[str]:
    """Yield the table, and where bodies overlap."""
    plans = answer.recorded, answer.resolved
    rows = [('figure of the plan', 'recorded', 're-solved')]
    old, new = ({} if plan is None else dict(_figures(plan)) for plan in plans)
    rows += [(name, old.get(name, '-'), new.get(name, '-')) for name in {**new, **old}]
    yield from (f'  {line}' for line in aligned(rows))
    apart = answer.apart
    if apart is not None:
        yield (
            f'  largest distance between the two plans: {apart.value:.4f} m '
            f'({apart.name} at {apart.at_s:.3f} s)'
        )
    for what, plan in zip(('recorded', 're-solved'), plans, strict=True):
        for overlap in () if plan is None else plan.overlaps:
            yield f'  {what} plan: {_overlap(overlap)}'


def _figures(plan: PlanFigures) -> Iterator[tuple[str, str]]:
    """Yield the lines of one plan: what, and its value."""
    yield 'duration', f'{plan.duration_s:.3f} s'
    for robot, at_s in plan.goals_s.items():
        yield f'{robot} at goal', 'not reached' if at_s is None else f'{at_s:.2f} s'
    for pair, approach in plan.approaches.items():
        yield f'smallest distance {pair}', _approach(approach)
    yield 'smallest psi0', _extreme(plan.psi0, 'm')
    yield 'smallest psi1', _extreme(plan.psi1, 'm/s')
    yield 'largest intervention', _extreme(plan.intervention, 'm/s^2')
    mean = plan.mean_intervention
    yield 'mean intervention', '-' if mean is None else f'{mean:.4f} m/s^2'
    yield 'slack events', _count(plan.slack_events)
    yield 'solver failures', _count(plan.solver_failures)
    for robot, length in plan.paths_m.items():
        yield f'path of {robot}', f'{length:.3f} m'


def _count(value: int | None) -> str:
    return '-' if value is None else str(value)


def _approach(it: Approach) -> str:
    return f'{it.distance_m:.3f} m, margin {it.margin_m:+.3f} m, at {it.at_s:.2f} s'


def _extreme(it: Extreme | None, unit: str) -> str:
    return '-' if it is None else f'{it.value:.4f} {unit} ({it.name} at {it.at_s:.2f} s)'


def _overlap(it: Overlap) -> str:
    return (
        f'{it.pair} overlap from {it.begin_s:.2f} s to {it.end_s:.2f} s, '
        f'{it.depth_m:.3f} m deep at {it.deepest_s:.2f} s'
    )
