"""Obstacle tracker: from nameless detections to named tracks with a velocity.

One Kalman filter an object. Each message's detections are given to the objects
that explain them best (global nearest neighbour); what no object explains starts a
new one, which is believed once it has been seen often enough, and forgotten when
it hasn't been seen for long. A message that comes late is put in its place: the
filters go back to the time before it and take all later messages again. A stamp
farther from the present than any object is remembered is a clock gone wrong, unless
the next message confirms it: then all begins anew there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array, Track
from layered_cbf_ros.perception.assignment import assign
from layered_cbf_ros.perception.kalman import innovation, predict, update
from layered_cbf_ros.perception.parameters import ObstacleTrackerParameters

_UNSEEN = 1e6  # cost of leaving an object without a detection: above that of any pair


@dataclass(frozen=True, slots=True)
class TrackedObject:
    """One object, believed or not.

    Attributes:
        number: Its number, never given to another.
        mean, covariance: Estimate of position and velocity, (4,), (4, 4).
        last_seen_ns: Time of its last detection [ns].
        hits: Its detections so far.
        messages: Messages since it was first seen, that one included.
    """

    number: int
    mean: Array
    covariance: Array
    last_seen_ns: int
    hits: int = 1
    messages: int = 1


@dataclass(frozen=True, slots=True)
class Frame:
    """One message, and the objects once it was taken in.

    Attributes:
        stamp_ns: Its time [ns].
        detections: Its points [m], (K, 2); None in the frame that starts it all.
        late: Whether it came after a later one.
        objects: The objects at its time.
        born: How many objects there have been so far.
    """

    stamp_ns: int
    detections: Array | None
    late: bool = False
    objects: tuple[TrackedObject, ...] = ()
    born: int = 0


@dataclass(frozen=True, slots=True)
class TrackerState:
    """What the tracker remembers.

    Attributes:
        stamp_ns: Present time [ns].
        frames: The last messages by time: those that a late one may precede, and
            one before.
        doubted_ns: Stamp of the last message if it was refused for its jump [ns].
    """

    stamp_ns: int
    frames: tuple[Frame, ...]
    doubted_ns: int | None = None


@dataclass(frozen=True, slots=True)
class TrackerResult:
    """One step of the tracker.

    Attributes:
        state: To be given to the next step.
        tracks: All believed objects at the state's time.
        rejected: Detections that were not finite, too late, given twice, or of a message
            whose stamp jumps.
    """

    state: TrackerState
    tracks: tuple[Track, ...]
    rejected: int


class ObstacleTracker:
    """Estimates where obstacles are and where they go."""

    def __init__(self, parameters: ObstacleTrackerParameters) -> None:
        """Keep the parameters; all else is in the state."""
        self._p = parameters

    def start(self, stamp_ns: int) -> TrackerState:
        """Return the state of a tracker that has seen nothing, at a time [ns]."""
        return TrackerState(stamp_ns, (Frame(stamp_ns, None),))

    def step(self, state: TrackerState, stamp_ns: int, detections: Array | None) -> TrackerResult:
        """Take in one message, or let time pass.

        Args:
            state: From `start` or the last step.
            stamp_ns: When the detections were measured [ns]; may lie in the past.
            detections: Points seen [m], (K, 2); None if there was no message.
        """
        if detections is None:
            return self._result(replace(state, stamp_ns=max(stamp_ns, state.stamp_ns)), 0)
        if self._jumps(state.stamp_ns, stamp_ns):
            if state.doubted_ns is None or self._jumps(state.doubted_ns, stamp_ns):
                return self._result(replace(state, doubted_ns=stamp_ns), len(detections))
            frame = Frame(stamp_ns, None, born=state.frames[-1].born)
            state = TrackerState(stamp_ns, (frame,))
        now = max(stamp_ns, state.stamp_ns)
        finite = np.isfinite(detections).all(axis=1)
        rejected = int(np.count_nonzero(~finite))
        taken = any(f.stamp_ns == stamp_ns and f.detections is not None for f in state.frames)
        if stamp_ns < state.frames[0].stamp_ns or taken:
            return self._result(TrackerState(now, state.frames), len(detections))
        earlier = [frame for frame in state.frames if frame.stamp_ns <= stamp_ns]
        later = [frame for frame in state.frames if frame.stamp_ns > stamp_ns]
        frames = earlier
        for frame in (Frame(stamp_ns, detections[finite], late=bool(later)), *later):
            frames.append(self._taken_in(frames[-1], frame))
        oldest = now - round(self._p.late_window * NS_PER_S)
        needless = sum(frame.stamp_ns < oldest for frame in frames) - 1
        return self._result(TrackerState(now, tuple(frames[max(needless, 0) :])), rejected)

    def _taken_in(self, before: Frame, frame: Frame) -> Frame:
        """Return the frame with its objects, which follow from those before."""
        points = frame.detections if frame.detections is not None else np.zeros((0, 2))
        alive = [it for it in before.objects if self._lives(it, frame.stamp_ns)]
        objects = [self._predicted(it, before.stamp_ns, frame.stamp_ns) for it in alive]
        left = np.ones(len(points), dtype=bool)
        for believed in (True, False):  # a doubtful object gets what no believed one wants
            chosen = [k for k, it in enumerate(objects) if self._is_believed(it) == believed]
            free = np.flatnonzero(left)
            matches = self._matches([objects[k] for k in chosen], points[free])
            for k, match in zip(chosen, matches, strict=True):
                point = None if match is None else points[free[match]]
                if match is not None:
                    left[free[match]] = False
                objects[k] = self._updated(objects[k], point, frame.stamp_ns)
        objects = [it for it in objects if self._lives(it, frame.stamp_ns)]
        births = points[:0] if frame.late else points[left]
        objects += [
            self._newborn(before.born + k, point, frame.stamp_ns)
            for k, point in enumerate(births, start=1)
        ]
        return replace(frame, objects=tuple(objects), born=before.born + len(births))

    def _matches(self, objects: Sequence[TrackedObject], points: Array) -> list[int | None]:
        """Return the point of each object, None where none lies in its gate.

        The cost of a pair is -2 ln of the detection's likelihood, d^2 + ln |S|: with
        d^2 alone, a long lost object, which is near to everything, would rob others.
        """
        if not objects or not len(points):
            return [None] * len(objects)
        cost = np.full((len(objects), len(points) + len(objects)), _UNSEEN)
        for row, it in zip(cost, objects, strict=True):
            errors, spread = innovation(it.mean, it.covariance, points, self._p.noise)
            squared = (errors @ np.linalg.inv(spread) * errors).sum(axis=1)
            inside = np.flatnonzero(squared < self._p.gate**2)
            row[inside] = squared[inside] + math.log(np.linalg.det(spread))
        columns = assign(cost)
        return [
            column if column < len(points) and row[column] < _UNSEEN else None
            for row, column in zip(cost, columns, strict=True)
        ]

    def _predicted(self, it: TrackedObject, from_ns: int, to_ns: int) -> TrackedObject:
        dt = (to_ns - from_ns) / NS_PER_S
        mean, covariance = predict(it.mean, it.covariance, dt, self._p.acceleration)
        return replace(it, mean=mean, covariance=covariance)

    def _updated(self, it: TrackedObject, point: Array | None, stamp_ns: int) -> TrackedObject:
        if point is None:
            return replace(it, messages=it.messages + 1)
        mean, covariance = update(it.mean, it.covariance, point, self._p.noise)
        return TrackedObject(it.number, mean, covariance, stamp_ns, it.hits + 1, it.messages + 1)

    def _newborn(self, number: int, point: Array, stamp_ns: int) -> TrackedObject:
        variances = np.repeat((self._p.noise**2, self._p.initial_speed**2), 2)
        return TrackedObject(number, np.append(point, (0.0, 0.0)), np.diag(variances), stamp_ns)

    def _is_believed(self, it: TrackedObject) -> bool:
        return it.hits >= self._p.birth_hits

    def _lives(self, it: TrackedObject, stamp_ns: int) -> bool:
        if self._is_believed(it):
            return stamp_ns - it.last_seen_ns <= self._p.death_time * NS_PER_S
        return it.messages < self._p.birth_window

    def _jumps(self, from_ns: int, to_ns: int) -> bool:
        return abs(to_ns - from_ns) > self._p.death_time * NS_PER_S

    def _result(self, state: TrackerState, rejected: int) -> TrackerResult:
        last = state.frames[-1]
        believed = [it for it in last.objects if self._is_believed(it)]
        present = [self._predicted(it, last.stamp_ns, state.stamp_ns) for it in believed]
        tracks = tuple(
            self._track(it, state.stamp_ns) for it in present if self._lives(it, state.stamp_ns)
        )
        return TrackerResult(state, tracks, rejected)

    @staticmethod
    def _track(it: TrackedObject, stamp_ns: int) -> Track:
        """Return what is told of an object; of its radius, which no detection tells, 0."""
        name = f'obstacle_{it.number}'
        return Track(name, stamp_ns, it.mean[:2], it.mean[2:], it.covariance, radius=0.0)
