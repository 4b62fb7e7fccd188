"""What nodes tell of themselves on /diagnostics, for a person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from layered_cbf_ros.viewing.sight.snapshot import NodeSight

LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')
STALE_AFTER = 3.0
"""A node that was silent for so long is stale [s] of wall time."""


def node_sights(message: Any) -> list[NodeSight]:
    """Return what a DiagnosticArray tells; it doesn't matter who has decoded it."""
    sights = []
    for status in message.status:
        level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
        values = {entry.key: entry.value for entry in status.values}
        word = LEVELS[level] if level < len(LEVELS) else LEVELS[-1]
        sights.append(NodeSight(status.name, word, status.message, values))
    return sights


def heard_nodes(nodes: Mapping[str, tuple[NodeSight, float]], now: float) -> tuple[NodeSight, ...]:
    """Return all nodes by name, those that fell silent as stale.

    Args:
        nodes: What each told last, and when [s].
        now: The time [s].
    """
    return tuple(
        replace(sight, level='STALE') if _is_silent(sight, now - heard) else sight
        for _, (sight, heard) in sorted(nodes.items())
    )


def _is_silent(sight: NodeSight, age: float) -> bool:
    """Tell whether a node should have told something by now; one that has ended needn't."""
    return age > STALE_AFTER and sight.values.get('state') != 'ended'
