"""Ending processes in order: asked, asked again, then killed."""

from __future__ import annotations

import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol


class Process(Protocol):
    """What a child process looks like from here."""

    missing: str

    def poll(self) -> int | None:
        """Return the exit code, None while it runs."""
        ...

    def send(self, number: signal.Signals) -> None:
        """Send a signal, if it still runs."""
        ...


@dataclass(frozen=True, slots=True)
class Patience:
    """Time limits of a run, wall time [s].

    Attributes:
        ready: For every node to become ready.
        reports: For further nodes to tell whom they miss, after the first did.
        standstill: Without any progress of the plant's clock.
        interrupt: Between SIGINT and SIGTERM.
        terminate: Between SIGTERM and SIGKILL.
        restart: Before a node that died is started again.
        restarts: How often one node may be started again.
    """

    ready: float = 60.0
    reports: float = 2.0
    standstill: float = 20.0
    interrupt: float = 6.0
    terminate: float = 2.0
    restart: float = 0.5
    restarts: int = 3


class Shutdown:
    """Ends groups of processes, one group after the other."""

    def __init__(self, groups: Sequence[Mapping[str, Process]], patience: Patience) -> None:
        self._groups = list(groups)
        self._patience = patience
        self._due: list[tuple[float, signal.Signals]] = []
        self._begun = False
        self.killed: list[str] = []

    def step(self, now: float) -> bool:
        """Send what is due; return True once all have ended."""
        while self._groups and not self._running(self._groups[0]):
            self._groups.pop(0)
            self._begun = False
        if not self._groups:
            return True
        if not self._begun:
            self._begun = True
            second = now + self._patience.interrupt
            third = second + self._patience.terminate
            self._due = [
                (now, signal.SIGINT),
                (second, signal.SIGTERM),
                (third, signal.SIGKILL),
            ]
        while self._due and now >= self._due[0][0]:
            self._send(self._groups[0], self._due.pop(0)[1])
        return False

    def kill(self) -> None:
        """Kill whatever still runs."""
        for group in self._groups:
            self._send(group, signal.SIGKILL)

    def _send(self, group: Mapping[str, Process], number: signal.Signals) -> None:
        for name, process in self._running(group).items():
            process.send(number)
            if number == signal.SIGKILL:
                self.killed.append(name)

    @staticmethod
    def _running(group: Mapping[str, Process]) -> dict[str, Process]:
        return {name: process for name, process in group.items() if process.poll() is None}
