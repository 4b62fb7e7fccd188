"""The states of robots that each have a topic of their own, joined as if they had one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from layered_cbf_ros.bags.run.series import Series
from layered_cbf_ros.node_topics import robot_state
from layered_cbf_ros.scenario import Scenario


def is_robot_state(topic: str) -> bool:
    """Tell whether a topic may be the state of one robot."""
    return topic == robot_state(topic.strip('/').rpartition('/')[0])


def joined_states(told: Mapping[str, Series], scenario: Scenario) -> Series | None:
    """Return the states of all robots at the stamps of the last one.

    Robots are not in step: of each other one, its newest state at each stamp counts. It
    begins once all have been heard.

    Args:
        told: Their states, by topic.
        scenario: Who they are.

    Returns:
        Fields are position, velocity and effort, as of /state; None without any.
    """
    series = [told[t] for robot in scenario.robots if (t := robot_state(robot.name)) in told]
    if not series:
        return None
    begin_ns = max(int(each.stamps_ns[0]) for each in series)
    stamps = series[-1].stamps_ns[series[-1].stamps_ns >= begin_ns]
    if not len(stamps):
        return None
    rows = [np.searchsorted(each.stamps_ns, stamps, side='right') - 1 for each in series]
    values = [each.values[k] for each, k in zip(series, rows, strict=True)]
    return Series(
        tuple(name for each in series for name in each.names),
        stamps,
        np.concatenate(values, axis=2),
        sum(each.contradictions for each in series),
    )
