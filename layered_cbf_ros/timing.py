"""Which inputs make a tick: one rule, two modes.

Every message carries the stamp of the state it was computed from. A node ticks on
a state; its other inputs are older by a fixed latency, so that the layers compute
side by side instead of one after the other.

In lockstep each input must have exactly the wanted stamp: a run then repeats to
the bit, whatever the load of the machine. In real time the newest input counts,
unless it is older than its age limit.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.parameters import parameter
from layered_cbf_ros.scenario import EMULATED_A1, Scenario

LOCKSTEP, REAL_TIME = 'lockstep', 'real_time'
SCRIPT_NS = 20_000_000
"""Period of a scripted operator's Joy messages [ns]."""


@dataclass(frozen=True)
class TimingParameters:
    """Rates of the graph; every node of a run has the same."""

    time: str = parameter(
        LOCKSTEP, 'how inputs are matched to a tick', choices=(LOCKSTEP, REAL_TIME)
    )
    state_rate: int = parameter(1000, 'states and joint commands', 'Hz', 100, 1000)
    plan_rate: int = parameter(500, 'safe trajectories and ground forces', 'Hz', 50, 1000)
    detection_rate: int = parameter(100, 'obstacle detections and tracks', 'Hz', 1, 1000)
    detection_delay: float = parameter(
        0.0, 'age of detections when they are sent, as the scenario has it', 's', 0.0, 1.0
    )
    age_limit: float = parameter(0.05, 'oldest plan or force used in real time', 's', 0.002, 1.0)
    command_age_limit: float = parameter(
        0.02, 'oldest joint command that acts in real time', 's', 0.002, 1.0
    )
    patience: float = parameter(
        5.0, 'wall time to wait for an input in lockstep before giving up', 's', 0.1, 600.0
    )
    pace: float = parameter(
        1.0, "run's time that passes in a second, of emulated robots in real time", '', 0.01, 1.0
    )
    epoch_ns: int = parameter(
        0, "wall time at which the run's time is 0; 0: the run's time is wall time", 'ns', 0, 2**62
    )

    @property
    def tick_ns(self) -> int:
        """Return the period of the states [ns]."""
        return NS_PER_S // self.state_rate

    @property
    def plan_ns(self) -> int:
        """Return the period of plans and forces [ns]."""
        return NS_PER_S // self.plan_rate

    @property
    def detection_ns(self) -> int:
        """Return the period of detections [ns]."""
        return NS_PER_S // self.detection_rate

    @property
    def detection_delay_periods(self) -> int:
        """Return the age of sent detections in their periods."""
        return round(self.detection_delay * self.detection_rate)


def timing_values(scenario: Scenario) -> dict[str, Any]:
    """Return the timing parameters that a scenario settles for all nodes of its run."""
    return {
        'time': scenario.time,
        'state_rate': scenario.rates.state,
        'plan_rate': scenario.rates.plan,
        'detection_rate': scenario.rates.detections,
        'detection_delay': scenario.world.detections.delay,
        'pace': scenario.pace if scenario.plant == EMULATED_A1 else 1.0,
    }


@dataclass(frozen=True)
class InputRule:
    """How old an input is.

    Attributes:
        period_ns: Its sender's period [ns].
        latency_ns: Least age of the message that a tick uses in lockstep [ns].
        age_limit_ns: Greatest age of the message that a tick uses in real time [ns].
    """

    period_ns: int
    latency_ns: int
    age_limit_ns: int

    def wanted(self, tick_ns: int) -> int | None:
        """Return the stamp that a lockstep tick needs, None before the first [ns]."""
        stamp_ns = (tick_ns - self.latency_ns) // self.period_ns * self.period_ns
        return stamp_ns if stamp_ns >= 0 else None


class InputRules:
    """The latencies between the layers, in one place."""

    def __init__(self, timing: TimingParameters) -> None:
        tick, plan, age = timing.tick_ns, timing.plan_ns, round(timing.age_limit * NS_PER_S)
        detection = timing.detection_ns
        seen = detection * (1 + timing.detection_delay_periods)
        self.plan = InputRule(plan, tick, age)
        self.forces = InputRule(plan, 2 * tick, age)
        self.tracks = InputRule(detection, seen, NS_PER_S)
        self.operator = InputRule(SCRIPT_NS, tick, NS_PER_S)
        self.command = InputRule(tick, tick, round(timing.command_age_limit * NS_PER_S))


class StampGuard:
    """Tells a running clock from single stamps that are wrong.

    One message with another clock's stamp would otherwise silence a node that
    waits for newer ones. A jump ahead is believed when a second stamp follows it.
    """

    def __init__(self, longest_gap_ns: int = NS_PER_S) -> None:
        self._gap_ns = longest_gap_ns
        self._last_ns: int | None = None
        self._suspect_ns: int | None = None

    def check(self, data: bytes) -> int:
        """Take note of a message; return its stamp [ns].

        Raises:
            MessageError: If it is from the past, or far ahead and alone so far.
        """
        stamp_ns = stamp_of(data)
        if self._last_ns is None or self._follows(stamp_ns, self._last_ns):
            self._last_ns, self._suspect_ns = stamp_ns, None
        elif stamp_ns < self._last_ns:
            late = (self._last_ns - stamp_ns) / NS_PER_S
            raise MessageError(f'stamp {stamp_ns / NS_PER_S:.3f} s is {late:.3f} s in the past')
        elif self._suspect_ns is not None and self._follows(stamp_ns, self._suspect_ns):
            self._last_ns, self._suspect_ns = stamp_ns, None
        else:
            self._suspect_ns = stamp_ns
            raise MessageError(f'stamp {stamp_ns / NS_PER_S:.3f} s is in the future')
        return stamp_ns

    def _follows(self, stamp_ns: int, last_ns: int) -> bool:
        return 0 <= stamp_ns - last_ns <= self._gap_ns


class Inbox:
    """The messages of one input that may still be needed, by stamp.

    A message that is sent again after a suspected loss changes nothing.
    """

    def __init__(self, capacity: int = 64) -> None:
        self._messages: dict[int, bytes] = {}
        self._seen: deque[int] = deque(maxlen=2 * capacity)
        self._capacity = capacity
        self._used_ns = -1

    def offer(self, data: bytes) -> bool:
        """Keep a message; return False if it was there before.

        When there are too many, the farthest ahead goes: the present counts.

        Raises:
            MessageError: If it has no header, or a stamp from the past.
        """
        stamp_ns = stamp_of(data)
        if stamp_ns in self._seen:
            return False
        if stamp_ns < self._used_ns:
            late = (self._used_ns - stamp_ns) / NS_PER_S
            raise MessageError(f'stamp {stamp_ns / NS_PER_S:.3f} s is {late:.3f} s in the past')
        self._seen.append(stamp_ns)
        self._messages[stamp_ns] = data
        if len(self._messages) > self._capacity:
            self._forget(max(self._messages))
        return True

    def exactly(self, stamp_ns: int) -> bytes | None:
        """Return the message with this stamp, and forget the older ones."""
        if stamp_ns not in self._messages:
            return None
        self._forget_before(stamp_ns)
        return self._messages[stamp_ns]

    def drop_after(self, stamp_ns: int) -> int:
        """Forget the messages of a later stamp; return how many there were."""
        ahead = [stamp for stamp in self._messages if stamp > stamp_ns]
        for stamp in ahead:
            self._forget(stamp)
        return len(ahead)

    def newest(self, tick_ns: int, age_limit_ns: int) -> bytes | None:
        """Return the newest message, None if it is too old; forget the others."""
        if not self._messages:
            return None
        stamp_ns = max(self._messages)
        self._forget_before(stamp_ns)
        return self._messages[stamp_ns] if tick_ns - stamp_ns <= age_limit_ns else None

    def _forget(self, stamp_ns: int) -> None:
        del self._messages[stamp_ns]
        self._seen.remove(stamp_ns)

    def _forget_before(self, stamp_ns: int) -> None:
        self._used_ns = stamp_ns
        if len(self._messages) > 1:
            for old in [stamp for stamp in self._messages if stamp < stamp_ns]:
                del self._messages[old]
