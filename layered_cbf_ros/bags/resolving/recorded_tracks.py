"""Recorded tracks, gathered as the coordinator gathers them: an Odometry each, and how many."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import points_from, track_from
from layered_cbf_ros.node_topics import TRACKS
from layered_cbf_ros.perception.known_tracks import NewestTracks, TracksByStamp, track_radius
from layered_cbf_ros.scenario import Scenario


class CompleteTracks:
    """For lockstep: the tracks of a stamp, once as many have come as were announced."""

    def __init__(self, scenario: Scenario) -> None:
        self._radius = track_radius(scenario)
        self._decoder = MessageDecoder()
        self._tracks = TracksByStamp()
        self._announced: dict[int, int] = {}

    def take(self, record: Record) -> Iterator[tuple[int, tuple[Track, ...]]]:
        """Take a message of either topic; yield complete stamps [ns] with their tracks."""
        message = self._decoder.decode(record)
        if record.topic.name == TRACKS:
            try:
                self._tracks.offer(track_from(message, self._radius))
            except MessageError:
                return  # the coordinator refuses it too
        else:
            self._announced.setdefault(stamp_of(record.data), len(points_from(message)))
        for stamp_ns, count in sorted(self._announced.items()):
            due = self._tracks.due(stamp_ns)
            if len(due) < count:
                break
            del self._announced[stamp_ns]
            self._tracks.forget_before(stamp_ns + 1)
            yield stamp_ns, tuple(due)


class ArrivedTracks:
    """For real time: the newest tracks that had come when an answer was sent."""

    def __init__(self, scenario: Scenario) -> None:
        self._radius = track_radius(scenario)
        self._decoder = MessageDecoder()
        self._newest = NewestTracks()
        self._received: deque[tuple[int, Track | int]] = deque()

    def take(self, record: Record) -> None:
        """Take a message of either topic."""
        if record.topic.name != TRACKS:
            self._received.append((record.log_time_ns, stamp_of(record.data)))
            return
        try:
            track = track_from(self._decoder.decode(record), self._radius)
        except MessageError:
            return  # the coordinator refuses it too
        self._received.append((record.log_time_ns, track))

    def at(self, stamp_ns: int, sent_ns: int) -> tuple[Track, ...]:
        """Return the tracks of a tick whose answer was sent at a wall time [ns]."""
        while self._received and self._received[0][0] <= sent_ns:
            _, told = self._received.popleft()
            if isinstance(told, Track):
                self._newest.offer(told, stamp_ns)
            else:
                self._newest.announce(told, stamp_ns)
        return self._newest.at(stamp_ns)
