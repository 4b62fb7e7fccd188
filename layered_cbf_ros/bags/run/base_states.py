"""The states of bases without legs, put together from their odometry.

They look like /state with nothing but base entries, so that whoever reads states reads both.
A base is where the centre of its disc is: that is what the coordinator keeps apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import numpy as np

from layered_cbf_ros.bags.run.message_form import POSITION, VELOCITY, MessageForm, form_of
from layered_cbf_ros.bags.run.series import Series, SeriesBuilder
from layered_cbf_ros.discs import disc_offsets
from layered_cbf_ros.messages.cdr import CdrReader
from layered_cbf_ros.messages.odometry import COVARIANCE, POSE, TWIST
from layered_cbf_ros.messages.robot_state import base_names
from layered_cbf_ros.node_topics import odometry
from layered_cbf_ros.scenario import Scenario

FIELDS_OF_STATE = 3


class Odometries(SeriesBuilder):
    """nav_msgs/Odometry of one robot; fields are pose and twist, the name is its frame."""

    fields = POSE + TWIST

    def _learn(self, data: bytes) -> MessageForm:
        reader = CdrReader(data)
        reader.header()
        names = (reader.text(),)
        reader.fixed(POSE)
        reader.skip(COVARIANCE)
        reader.fixed(TWIST)
        reader.skip(COVARIANCE)
        return form_of(data, reader, names, [0], [(0, 0, POSE), (0, POSE, TWIST)])


class Velocities(SeriesBuilder):
    """geometry_msgs/TwistStamped; fields are those of the twist, the name is its frame."""

    fields = TWIST

    def _learn(self, data: bytes) -> MessageForm:
        reader = CdrReader(data)
        names = (reader.frame(),)
        reader.fixed(TWIST)
        return form_of(data, reader, names, [0], [(0, 0, TWIST)])


def is_odometry(topic: str) -> bool:
    """Tell whether a topic may be a robot's odometry."""
    return topic == odometry(topic.strip('/').rpartition('/')[0])


def base_states(told: Mapping[str, Series], scenario: Scenario) -> Series | None:
    """Return the states of all bases at the stamps that they have in common.

    Args:
        told: Their odometry, by topic.
        scenario: Who they are.

    Returns:
        Fields are position, velocity and effort, as of /state; None without any.
    """
    names = [robot.name for robot in scenario.robots if odometry(robot.name) in told]
    if not names:
        return None
    offsets = disc_offsets(scenario)
    series = [told[odometry(name)] for name in names]
    stamps = reduce(np.intersect1d, [each.stamps_ns for each in series])
    if not len(stamps):
        return None
    values = np.zeros((len(stamps), FIELDS_OF_STATE, POSE * len(names)))
    for k, (name, each) in enumerate(zip(names, series, strict=True)):
        motion = each.values[np.searchsorted(each.stamps_ns, stamps), :, 0]
        place = values[:, POSITION, POSE * k : POSE * (k + 1)]
        place[:] = motion[:, :POSE]
        values[:, VELOCITY, POSE * k : POSE * k + TWIST] = motion[:, POSE:]
        x, y, z, w = place[:, 3:7].T
        place[:, 0] += offsets[name] * (1.0 - 2.0 * (y * y + z * z))
        place[:, 1] += offsets[name] * 2.0 * (x * y + w * z)
        values[:, VELOCITY, POSE * k + 1] += offsets[name] * motion[:, POSE + 5]
    return Series(
        tuple(entry for name in names for entry in base_names(name)),
        stamps,
        values,
        sum(each.contradictions for each in series),
    )
