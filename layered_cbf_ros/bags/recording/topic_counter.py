"""What a recorder counts: how many messages of each topic, and how many were lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from layered_cbf_ros.messages.cdr import TEXT_OFFSET, stamp_of

STAMPED = frozenset(
    (
        'geometry_msgs/msg/PoseArray',
        'nav_msgs/msg/Odometry',
        'rosgraph_msgs/msg/Clock',
        'sensor_msgs/msg/Imu',
        'sensor_msgs/msg/JointState',
        'trajectory_msgs/msg/JointTrajectory',
        'trajectory_msgs/msg/MultiDOFJointTrajectory',
    )
)
"""Types that begin with a stamp, and that one sender sends at a steady rate."""

RESOLUTION_NS = 100_000
"""Gaps between stamps are counted in steps of this [ns]."""


@dataclass(slots=True)
class TopicCounter:
    """Counts the messages of one topic, and those lost on the way, by gaps between stamps.

    The usual gap is the commonest one; a gap of n usual ones tells of n - 1 lost.

    Attributes:
        stamped: Whether the topic's type is one of STAMPED; if not, none count as lost.
        received: Messages received.
        repeated: Of these, messages whose stamp wasn't newer than all before.
        last_ns: Newest stamp [ns], None before the first.
    """

    stamped: bool
    received: int = 0
    repeated: int = 0
    last_ns: int | None = None
    _gaps: Counter[int] = field(default_factory=Counter)

    def receive(self, data: bytes) -> int | None:
        """Count one message; return its stamp [ns], or None if it has none."""
        self.received += 1
        if not self.stamped or len(data) < TEXT_OFFSET:
            return None
        stamp_ns = stamp_of(data)
        if self.last_ns is None:
            self.last_ns = stamp_ns
        elif stamp_ns <= self.last_ns:
            self.repeated += 1
        else:
            self._gaps[round((stamp_ns - self.last_ns) / RESOLUTION_NS)] += 1
            self.last_ns = stamp_ns
        return stamp_ns

    @property
    def lost(self) -> int:
        """Messages that seem lost."""
        usual = self._usual
        if not usual:
            return 0
        return sum(
            count * (round(gap / usual) - 1)
            for gap, count in self._gaps.items()
            if gap > 1.5 * usual
        )

    @property
    def usual_gap_ns(self) -> int:
        """Return the commonest gap between stamps [ns], 0 before there is any."""
        return self._usual * RESOLUTION_NS

    @property
    def _usual(self) -> int:
        return max(self._gaps, key=lambda gap: (self._gaps[gap], -gap), default=0)


def counter_for(type_name: str) -> TopicCounter:
    """Return a counter for a topic of this type, `package/msg/Type`."""
    return TopicCounter(stamped=type_name in STAMPED)
