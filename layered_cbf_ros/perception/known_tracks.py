"""Which tracks a tick of the coordinator uses, out of those that have come."""

from __future__ import annotations

from operator import itemgetter

from layered_cbf_ros.interfaces import NS_PER_S, Track
from layered_cbf_ros.scenario import Scenario

FUTURE_NS = NS_PER_S // 10
"""A stamp farther ahead is wrong [ns]."""

GONE_NS = NS_PER_S // 2
"""A track that its tracker leaves out for so long is gone [ns]."""

FORGOTTEN_NS = 60 * NS_PER_S
"""A track that nobody speaks of for so long is gone too [ns]."""


def track_radius(scenario: Scenario) -> float:
    """Return the radius of every track [m]: who is seen isn't known, so that of the largest."""
    return max((obstacle.radius for obstacle in scenario.obstacles), default=0.0)


class TracksByStamp:
    """For lockstep: all tracks of one stamp, however late some of them come."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[int, str], Track] = {}

    def offer(self, track: Track) -> None:
        """Keep a track; one that is sent again takes its own place."""
        self._waiting[track.stamp_ns, track.name] = track

    def due(self, stamp_ns: int) -> list[Track]:
        """Return the tracks of a stamp in an order that does not depend on their way."""
        return [
            track
            for (stamp, _), track in sorted(self._waiting.items(), key=itemgetter(0))
            if stamp == stamp_ns
        ]

    def forget_before(self, stamp_ns: int) -> None:
        """Forget the tracks of older stamps."""
        self._waiting = {key: track for key, track in self._waiting.items() if key[0] >= stamp_ns}


class NewestTracks:
    """For real time: the newest track of each name, until its tracker goes on without it.

    A track that is only silent stays: its reachable set grows with its age.
    """

    def __init__(self) -> None:
        self._announced_ns = 0
        self._tracks: dict[str, Track] = {}

    def offer(self, track: Track, tick_ns: int) -> bool:
        """Keep a track if it is the newest of its name; return False if its stamp is wrong.

        Args:
            track: As received.
            tick_ns: Stamp of the tick that is about to use it [ns].
        """
        old = self._tracks.get(track.name)
        if track.stamp_ns > tick_ns + FUTURE_NS:
            return False
        if old is None or track.stamp_ns >= old.stamp_ns:
            self._tracks[track.name] = track
        return True

    def announce(self, stamp_ns: int, tick_ns: int) -> None:
        """Take note that the tracker has told all its tracks of a stamp [ns]."""
        if stamp_ns <= tick_ns + FUTURE_NS:
            self._announced_ns = max(self._announced_ns, stamp_ns)

    def at(self, tick_ns: int) -> tuple[Track, ...]:
        """Return the tracks that a tick uses; those that are gone are forgotten."""
        gone_ns = max(self._announced_ns - GONE_NS, tick_ns - FORGOTTEN_NS)
        for name in [n for n, track in self._tracks.items() if track.stamp_ns < gone_ns]:
            del self._tracks[name]
        return tuple(self._tracks.values())
