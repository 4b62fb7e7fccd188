"""A scripted operator: what a simulated person holds on a virtual pad, and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from layered_cbf_ros.yaml_entry import Entry

STEERED = ('all', 'formation', 'nobody')
SOURCE = 'virtual_pad/script'
"""The frame_id of its Joy messages."""


@dataclass(frozen=True)
class PadStep:
    """What is held from a time on.

    Attributes:
        at: The time [s].
        x, y, yaw: Stick forward, to the left, turning left, each in [-1, 1].
        enable, turbo, e_stop, reset: Buttons.
        steer: A robot's name, 'all', 'formation' or 'nobody' to choose who is steered; ''
            for no change.
    """

    at: float
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    enable: bool = False
    turbo: bool = False
    e_stop: bool = False
    reset: bool = False
    steer: str = ''


def read_operator(entries: Sequence[Entry]) -> tuple[PadStep, ...]:
    """Read the steps of the script, strictly."""
    sticks, buttons = ('x', 'y', 'yaw'), ('enable', 'turbo', 'e_stop', 'reset')
    steps: list[PadStep] = []
    for entry in entries:
        given = entry.mapping(('at',), (*sticks, *buttons, 'steer'))
        at = given['at'].number(0.0, unit='[s]')
        if steps and at <= steps[-1].at:
            given['at'].refuse(f'give a time after {steps[-1].at:g} s, that of the step before')
        shares: dict[str, Any] = {n: given[n].number(-1.0, 1.0) for n in sticks if n in given}
        held: dict[str, Any] = {n: given[n].yes_or_no() for n in buttons if n in given}
        steer = given['steer'].text() if 'steer' in given else ''
        steps.append(replace(PadStep(at, steer=steer), **shares, **held))
    return tuple(steps)


def pad_step_form(step: PadStep) -> dict[str, Any]:
    """Return a step in the form of a scenario file."""
    return {name: value for name, value in asdict(step).items() if value or name == 'at'}


def held_at(script: Sequence[PadStep], time: float) -> PadStep:
    """Return the step that holds at a time [s]; before the first nothing is held."""
    current = PadStep(0.0)
    for step in script:
        if step.at > time:
            break
        current = step
    return current
