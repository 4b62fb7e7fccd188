"""The assignment problem: pair rows with columns at the least total cost."""

from __future__ import annotations

import numpy as np

from layered_cbf_ros.interfaces import Array


def assign(cost: Array) -> list[int]:
    """Return the column of each row of the cheapest assignment.

    Hungarian method by shortest augmenting paths, O(rows^2 columns): rows enter one
    by one; `u`, `v` are dual prices with cost - u - v >= 0, zero on the pairs taken.

    Args:
        cost: Finite costs, at least as many columns as rows, (n, m).
    """
    rows, columns = cost.shape
    u, v = np.zeros(rows), np.zeros(columns + 1)
    row_of = np.full(columns + 1, -1)  # the last, virtual column holds the entering row
    for row in range(rows):
        row_of[columns] = row
        here, back = columns, np.full(columns, columns)
        slack = np.full(columns, np.inf)
        done = np.zeros(columns + 1, dtype=bool)
        while row_of[here] >= 0:
            done[here] = True
            reduced = cost[row_of[here]] - u[row_of[here]] - v[:columns]
            closer = ~done[:columns] & (reduced < slack)
            slack[closer], back[closer] = reduced[closer], here
            open_slack = np.where(done[:columns], np.inf, slack)
            following = int(np.argmin(open_slack))
            step = open_slack[following]
            u[row_of[done]] += step
            v[done] -= step
            slack -= step
            here = following
        while here != columns:  # turn the path's pairs over
            previous = int(back[here])
            row_of[here] = row_of[previous]
            here = previous
    column_of = [0] * rows
    for column in range(columns):
        if row_of[column] >= 0:
            column_of[row_of[column]] = column
    return column_of
