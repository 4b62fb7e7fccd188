"""The course of a run: start all, wait until all are ready, watch, end in order.

Time, processes and what is heard from the graph come in as arguments, so that any
history can be played to it.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from layered_cbf_ros.errors import EXIT_MISSING
from layered_cbf_ros.supervision.child import describe_exit
from layered_cbf_ros.supervision.process_plan import ProcessSpec
from layered_cbf_ros.supervision.shutdown import Patience, Process, Shutdown


class Code(enum.IntEnum):
    """How a run ended, as an exit code."""

    FINISHED = 0
    FAILED = 1
    STOPPED = 130


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """How a run ended.

    Attributes:
        code: Finished, failed, or stopped by the user.
        reason: Why, in words.
        missing: The nodes at the root of a failure.
    """

    code: Code
    reason: str
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class News:
    """What was heard from the graph so far.

    Attributes:
        ready: The nodes that told to be ready.
        clock: Simulated time [s], None before the first word of it.
        silent: The nodes whose diagnostics have stopped.
        paused: Whether the plant tells, and goes on telling, that it was paused.
        finished: Whether the plant tells that the scenario is over.
    """

    ready: frozenset[str] = frozenset()
    clock: float | None = None
    silent: tuple[str, ...] = ()
    paused: bool = False
    finished: bool = False


class Phase(enum.Enum):
    """Where a run is."""

    STARTING = 'starting'
    RUNNING = 'running'
    STOPPING = 'stopping'
    ENDED = 'ended'


def root_cause(reports: Mapping[str, str]) -> tuple[str, ...]:
    """Return who kept all others waiting.

    A node that waits in vain names whom it waits for. Whoever is named but names
    nobody himself is the cause; if all name each other, everybody named is.

    Args:
        reports: Whom each reporting node misses, by its name.
    """
    named = {name for name in reports.values() if name}
    return tuple(sorted(named - set(reports) or named))


class Supervisor:
    """Watches the processes of one run."""

    def __init__(
        self,
        plan: Sequence[ProcessSpec],
        launch: Callable[[ProcessSpec], Process],
        tell: Callable[[str, str], None],
        patience: Patience | None = None,
    ) -> None:
        """Prepare a run; the first step starts it.

        Args:
            plan: Its processes.
            launch: Starts one.
            tell: Called with a node's name and what happened to it.
            patience: Time limits.
        """
        self.phase = Phase.STARTING
        self.processes: dict[str, Process] = {}
        self.ended: dict[str, int] = {}
        self._plan = {spec.name: spec for spec in plan}
        self._launch = launch
        self._tell = tell
        self._patience = patience or Patience()
        self._restarts = dict.fromkeys(self._plan, 0)
        self._restart_at: dict[str, float] = {}
        self._began = 0.0
        self._progress = (0.0, -1.0)
        self._judge_at: float | None = None
        self._outcome = RunOutcome(Code.FAILED, 'not run')
        self._shutdown: Shutdown | None = None

    def step(self, now: float, news: News) -> RunOutcome | None:
        """Do what is due; return the outcome once every process has ended.

        Args:
            now: Wall time [s].
            news: What was heard from the graph.
        """
        if not self.processes:
            self._began = now
            for spec in self._plan.values():
                self.processes[spec.name] = self._launch(spec)
        self._note_ends(now)
        if self.phase is Phase.STARTING:
            self._start(now, news)
        elif self.phase is Phase.RUNNING:
            self._run(now, news)
        if self._shutdown is not None and self._shutdown.step(now):
            self.phase = Phase.ENDED
            for name in self._shutdown.killed:
                self._tell(name, 'was killed')
        return self._outcome if self.phase is Phase.ENDED else None

    def stop(self) -> None:
        """End the run in order, as the user wishes."""
        self._stop(RunOutcome(Code.STOPPED, 'stopped by the user'))

    def kill(self) -> None:
        """End it now."""
        self.stop()
        if self._shutdown is not None:
            self._shutdown.kill()

    def _note_ends(self, now: float) -> None:
        """Take note of processes that ended since the last step, and restart them."""
        for name, process in self.processes.items():
            code = process.poll()
            if code is None or name in self.ended:
                continue
            self.ended[name] = code
            if self.phase in (Phase.STARTING, Phase.RUNNING):
                self._judge_end(now, name, code)
        if self.phase is Phase.RUNNING:
            for name in [n for n, due in self._restart_at.items() if now >= due]:
                del self._restart_at[name], self.ended[name]
                self.processes[name] = self._launch(self._plan[name])

    def _judge_end(self, now: float, name: str, code: int) -> None:
        """Decide what the end of one process means for the run."""
        spec = self._plan[name]
        may_restart = spec.restarts_after(code) and self._restarts[name] < self._patience.restarts
        outlived = self.phase is Phase.RUNNING or not spec.needed
        if spec.keeps_time and code == 0:
            self._stop(RunOutcome(Code.FINISHED, 'finished'))
        elif may_restart and outlived:
            self._restarts[name] += 1
            self._restart_at[name] = now + self._patience.restart
            count = f'{self._restarts[name]} of {self._patience.restarts}'
            self._tell(name, f'{describe_exit(code)}; started again ({count})')
        elif not spec.ends_run and outlived:
            rest = 'its robot is damped, the others go on' if spec.needed else 'the run goes on'
            self._tell(name, f'{describe_exit(code)}; {rest}')
        elif code == EXIT_MISSING:
            self._tell(name, describe_exit(code))
            if self._judge_at is None:
                self._judge_at = now + self._patience.reports
        else:
            reason = f'{name} {describe_exit(code)}'
            self._stop(RunOutcome(Code.FAILED, reason, (name,)))

    def _start(self, now: float, news: News) -> None:
        absent = [
            name for name, spec in self._plan.items() if spec.needed and name not in news.ready
        ]
        if not absent:
            self.phase = Phase.RUNNING
            self._progress = (now, -1.0)
        elif now - self._began > self._patience.ready:
            self._stop(RunOutcome(Code.FAILED, f'not ready: {", ".join(absent)}', tuple(absent)))
        self._judge_reports(now)

    def _run(self, now: float, news: News) -> None:
        clock = self._progress[1] if news.clock is None else news.clock
        if news.paused or clock != self._progress[1]:
            self._progress = (now, clock)
        if news.finished:
            self._stop(RunOutcome(Code.FINISHED, 'finished'))
        self._judge_reports(now)
        timed = any(spec.keeps_time for spec in self._plan.values())
        if timed and now - self._progress[0] > self._patience.standstill:
            silent = tuple(name for name in news.silent if name not in self.ended)
            names = ', '.join(silent) or 'nobody in particular'
            reason = f'no progress for {self._patience.standstill:.0f} s; silent: {names}'
            self._stop(RunOutcome(Code.FAILED, reason, silent))

    def _judge_reports(self, now: float) -> None:
        """Name the root cause once everybody had time to tell whom he misses."""
        if self._judge_at is None or now < self._judge_at:
            return
        gave_up = [name for name, code in self.ended.items() if code == EXIT_MISSING]
        cause = root_cause({name: self.processes[name].missing for name in gave_up})
        silent = ', '.join(cause) or 'somebody unknown'
        reason = f'{silent} did not answer ({len(gave_up)} waited in vain)'
        self._stop(RunOutcome(Code.FAILED, reason, cause))

    def _stop(self, outcome: RunOutcome) -> None:
        """Begin to end all processes; the first reason to do so counts."""
        if self.phase in (Phase.STOPPING, Phase.ENDED):
            return
        self.phase, self._outcome = Phase.STOPPING, outcome
        turns: dict[int, dict[str, Process]] = {}
        for name, process in self.processes.items():
            turns.setdefault(self._plan[name].turn, {})[name] = process
        self._shutdown = Shutdown([turns[turn] for turn in sorted(turns)], self._patience)
