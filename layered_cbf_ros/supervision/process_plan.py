"""Which processes a run consists of."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.run_nodes import (
    DRIVER,
    EMULATOR,
    OF_ONE_ROBOT,
    PLANTS,
    RECORDER,
    VIEWER,
    node_names,
    plant_of,
)
from layered_cbf_ros.scenario import HARDWARE, Scenario
from layered_cbf_ros.supervision.hosts import ALL, share_of
from layered_cbf_ros.supervision.shutdown import Patience
from layered_cbf_ros.timing import REAL_TIME

SWITCHING_OFF = 3.0  # time that a driver takes to damp its robot and switch it off [s]
EXIT_REFUSED = 2  # of a program that could not work with what it was told
# A driver needs its robot until it has switched it off; the recorder hears everybody end.
TURNS = {EMULATOR: 1, RECORDER: 2}
# A robot whose controller died lies damped: a new one would make it jump up.
ONCE = (*(name.strip('/') for name in (*PLANTS, RECORDER)), *OF_ONE_ROBOT)


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process of a run: one node.

    Attributes:
        name: Full name of its node, as in `/a1_0/whole_body_controller`.
        executable: Which program of the package it is.
        arguments: Its command line.
        restarts: Whether it is started again if it dies; only in real time, and
            only what keeps no world, no file and no robot on its legs.
        ends_run: Whether its death, if it isn't started again, ends the run.
        turn: When it is ended: those of a lower turn have ended before.
        ends_itself: Whether it ends in order if its supervisor dies; others are killed.
        needed: Whether the run waits for it to begin.
        keeps_time: Whether the run is over when it ends in order.
    """

    name: str
    executable: str
    arguments: tuple[str, ...]
    restarts: bool = False
    ends_run: bool = True
    turn: int = 0
    ends_itself: bool = False
    needed: bool = True
    keeps_time: bool = False

    def restarts_after(self, code: int) -> bool:
        """Tell whether it is started again after it ended with an exit code.

        Who is not needed, and ended in order or refused its command line, stays away.
        """
        return self.restarts and (self.needed or code not in (0, EXIT_REFUSED))

    @property
    def log_name(self) -> str:
        """Return the name of its log file."""
        return self.name.strip('/').replace('/', '.') + '.log'


def process_plan(
    scenario: Scenario, parameter_file: Path, record: bool, host: str = ALL
) -> tuple[ProcessSpec, ...]:
    """Return the processes of a run, in the order in which they are started.

    Args:
        scenario: What is run.
        parameter_file: Parameters of all nodes.
        record: Whether there is a recorder.
        host: Whose share it is, see `hosts`.
    """
    real_time, plant = scenario.time == REAL_TIME, plant_of(scenario)
    return tuple(
        _process(name, parameter_file, real_time, name == plant)
        for name in share_of(node_names(scenario, record), host)
    )


def _process(name: str, parameter_file: Path, real_time: bool, keeps_time: bool) -> ProcessSpec:
    namespace, _, node = name.rpartition('/')
    arguments = ['--ros-args', '--params-file', str(parameter_file)]
    if namespace:
        arguments += ['-r', f'__ns:={namespace}']
    return ProcessSpec(
        name=name,
        executable=node,
        arguments=tuple(arguments),
        restarts=real_time and node not in ONCE,
        ends_run=not real_time or node not in OF_ONE_ROBOT,
        turn=TURNS.get(name, 0),
        ends_itself=name == RECORDER or node == DRIVER,
        keeps_time=keeps_time,
    )


def patience_of(scenario: Scenario) -> Patience:
    """Return how long its processes may take; drivers switch robots off in the run's time."""
    usual = Patience()
    if scenario.plant not in HARDWARE:
        return usual
    return dataclasses.replace(usual, interrupt=usual.interrupt + SWITCHING_OFF / scenario.pace)


def viewer_process(arguments: Sequence[str]) -> ProcessSpec:
    """Return the page for people: a run neither waits for it nor ends with it.

    Args:
        arguments: Its command line.
    """
    return ProcessSpec(
        name=VIEWER,
        executable=VIEWER.strip('/'),
        arguments=tuple(arguments),
        restarts=True,
        ends_run=False,
        needed=False,
    )
