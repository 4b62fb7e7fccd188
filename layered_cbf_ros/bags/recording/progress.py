"""How far a recording has come: in lockstep the simulator waits for its slowest topic.

A message that was lost on the way is sent again, if its publisher still has it: so
nobody may run too far ahead of any topic, not only of the states.
"""

from __future__ import annotations

from collections.abc import Iterable

from layered_cbf_ros.bags.recording.topic_counter import TopicCounter

STEADY_NS = 20_000_000  # a topic with larger gaps is too rare to be waited for
SLACK_NS = 10_000_000  # beyond its usual lag and gap a topic may be so late
PATIENT_TURNS = 400  # with nothing new of a topic, then it is taken to have ended


class TopicProgress:
    """Follows one topic, turn by turn; turns, not time: who is stopped does not wait."""

    def __init__(self, counter: TopicCounter) -> None:
        self._counter = counter
        self._usual_ns = 0
        self._least_lag_ns: int | None = None
        self._last_ns: int | None = None
        self._turns = 0

    def refresh(self) -> None:
        """Learn the usual gap anew, now and then."""
        self._usual_ns = self._counter.usual_gap_ns

    def limit(self, state_ns: int) -> int:
        """Return up to which stamp the topic is recorded [ns].

        Args:
            state_ns: Newest recorded state: the limit if the topic sets none.
        """
        last_ns = self._counter.last_ns
        if not self._usual_ns:
            self.refresh()  # from the first messages on: nothing may be lost until then
        if last_ns is None or not 0 < self._usual_ns <= STEADY_NS:
            return state_ns
        lag_ns = state_ns - last_ns
        if self._least_lag_ns is None or lag_ns < self._least_lag_ns:
            self._least_lag_ns = lag_ns
        limit = last_ns + self._least_lag_ns + self._usual_ns + SLACK_NS
        if limit >= state_ns or last_ns != self._last_ns:
            self._last_ns, self._turns = last_ns, 0
        else:
            self._turns += 1
        return state_ns if self._turns > PATIENT_TURNS else min(limit, state_ns)


def recorded_up_to(state_ns: int, topics: Iterable[TopicProgress]) -> int:
    """Return up to which stamp every steady topic is recorded [ns].

    Args:
        state_ns: Stamp of the newest recorded state [ns].
        topics: All topics.
    """
    return min((topic.limit(state_ns) for topic in topics), default=state_ns)
