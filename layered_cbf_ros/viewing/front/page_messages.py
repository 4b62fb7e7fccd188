"""What a page says over its websocket: all that is held on it, thirty times a second."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.operation.virtual_pad import PadState

AXES = ('x', 'y', 'yaw')
HELD = ('enable', 'turbo', 'e_stop', 'reset')
ALL, FORMATION, RELEASE = '*all', '*formation', '*release'
"""What may be chosen besides a robot; no robot's name begins with a star."""


@dataclass(frozen=True, slots=True)
class PageMessage:
    """One message of a page.

    Attributes:
        number: Its count, growing.
        answers: The time that the page heard from us last [s], on our clock.
        pad: What is held.
    """

    number: int
    answers: float
    pad: PadState


def read_page_message(text: str, robots: Sequence[str]) -> PageMessage:
    """Return what a page says.

    Args:
        text: A JSON object: number, answers, x, y, yaw, enable, turbo, e_stop, reset, choose.
        robots: Names of the robots.

    Raises:
        MessageError: Naming the field that is missing, of the wrong type or out of range.
    """
    try:
        given = json.loads(text)
    except ValueError:
        raise MessageError('a page sent what is no JSON') from None
    if not isinstance(given, dict):
        raise MessageError('a page sent no JSON object')
    number, answers = _finite(given, 'number'), _finite(given, 'answers')
    pad: dict[str, Any] = {name: min(max(_finite(given, name), -1.0), 1.0) for name in AXES}
    pad |= {name: _flag(given, name) for name in HELD}
    pad |= _choice(given.get('choose', ''), robots)
    return PageMessage(int(number), answers, PadState(**pad))


def _finite(given: dict[str, Any], name: str) -> float:
    value = given.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise MessageError(f"a page sent '{name}': {value!r}; a finite number is wanted")
    return float(value)


def _flag(given: dict[str, Any], name: str) -> bool:
    value = given.get(name, False)
    if not isinstance(value, bool):
        raise MessageError(f"a page sent '{name}': {value!r}; true or false is wanted")
    return value


def _choice(value: object, robots: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a pad's state that choose robots."""
    if value == '':
        return {}
    if value in robots:
        return {'robot': list(robots).index(str(value))}
    fields = {ALL: 'select_all', FORMATION: 'formation', RELEASE: 'release'}
    if isinstance(value, str) and value in fields:
        return {fields[value]: True}
    known = ', '.join(robots) or 'none yet'
    raise MessageError(f'there is no robot {value!r}; the robots are: {known}')
