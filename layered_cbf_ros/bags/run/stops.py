"""Emergency stops of a run: when they were, and when each robot was told to sit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layered_cbf_ros.bags.run.run_record import RunRecord
from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.operation.told import E_STOP

HEIGHT, TOLD = 2, 3
"""Fields of a planned motion and of a tick of /coordinator/commands."""


def emergency_stops(record: RunRecord) -> tuple[float, ...]:
    """Return when an emergency stop began, since the first state [s].

    From what the coordinator was told; where a bag lacks that, from when robots began
    to be told to sit down.
    """
    commands, plan = record.commands, record.plan
    if commands is not None and E_STOP in commands.names:
        column = commands.names.index(E_STOP)
        begun = _begun(commands.values[:, TOLD, column] > 0.0)
        return tuple(record.seconds(commands.stamps_ns[begun]).tolist())
    if plan is None:
        return ()
    begun = _begun(np.any(plan.values[:, HEIGHT] < 0.0, axis=1))
    return tuple(record.seconds(plan.stamps_ns[begun]).tolist())


def told_to_sit(plan: Series | None, robot: str, stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell at which stamps the newest plan had a robot sit, lie or get up, (k,)."""
    if plan is None or robot not in plan.names:
        return np.zeros(len(stamps_ns), dtype=bool)
    sits = plan.values[:, HEIGHT, plan.names.index(robot)] < 0.0
    newest = np.searchsorted(plan.stamps_ns, stamps_ns, side='right') - 1
    told: NDArray[np.bool_] = (newest >= 0) & sits[newest]
    return told


def _begun(on: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the rows at which something that was off is on."""
    return np.flatnonzero(on & ~np.concatenate(([False], on[:-1])))
