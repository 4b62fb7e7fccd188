"""From the axes and buttons of a Joy message to what an operator wants."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.operation import virtual_pad
from layered_cbf_ros.operation.parameters import OFF, JoystickParameters


class Choice(enum.Enum):
    """Which robots the stick is for."""

    NEXT = 'next'
    ALL = 'all'
    FORMATION = 'formation'
    NOBODY = 'nobody'


@dataclass(frozen=True, slots=True)
class Hands:
    """What an operator's hands do at one moment.

    Attributes:
        x, y: Velocity forward and to the left [m/s].
        yaw_rate: Turning rate [rad/s].
        enable: Whether the dead-man button is held.
        e_stop: Whether the emergency stop is pressed.
        reset: Whether the reset button is held, and neither of the two above.
        choice: Which robots to steer from now on, the index of one, None for no change.
    """

    x: float = 0.0
    y: float = 0.0
    yaw_rate: float = 0.0
    enable: bool = False
    e_stop: bool = False
    reset: bool = False
    choice: Choice | int | None = None


def read_joy(
    frame_id: str,
    axes: Sequence[float],
    buttons: Sequence[int],
    parameters: JoystickParameters,
    robots: int,
) -> Hands:
    """Return what a Joy message says.

    Args:
        frame_id: Of its header; a virtual pad has a layout of its own.
        axes: In [-1, 1]; what is beyond is clamped.
        buttons: 1 where pressed.
        parameters: Layout and scales.
        robots: Size of the team.

    Raises:
        MessageError: If it has too few axes or buttons, or an axis isn't finite.
    """
    for number, value in enumerate(axes):
        if not math.isfinite(value):
            raise MessageError(f"joy from '{frame_id}': axes[{number}] is {value}")
    if frame_id.partition('/')[0] == virtual_pad.FRAME:
        return _virtual(frame_id, axes, buttons, parameters, robots)
    p = parameters
    pad = _Pad(frame_id, axes, buttons)
    turbo = pad.held(p.enable_turbo_button, 'enable_turbo_button')
    choices = {
        Choice.NEXT: pad.held(p.next_robot_button, 'next_robot_button'),
        Choice.ALL: pad.held(p.all_button, 'all_button'),
        Choice.FORMATION: pad.held(p.formation_button, 'formation_button'),
        Choice.NOBODY: pad.held(p.release_button, 'release_button'),
    }
    enable = pad.held(p.enable_button, 'enable_button')
    e_stop = pad.held(p.e_stop_button, 'e_stop_button')
    stick = (
        _past(pad.axis(p.axis_linear_x, 'axis_linear.x'), p.deadzone),
        _past(pad.axis(p.axis_linear_y, 'axis_linear.y'), p.deadzone),
        _past(pad.axis(p.axis_angular_yaw, 'axis_angular.yaw'), p.deadzone),
    )
    reset = pad.held(p.reset_button, 'reset_button')
    choice = next((choice for choice, held in choices.items() if held), None)
    return _hands(stick, p, turbo, enable, e_stop, reset, choice)


def _virtual(
    frame_id: str,
    axes: Sequence[float],
    buttons: Sequence[int],
    parameters: JoystickParameters,
    robots: int,
) -> Hands:
    """Return what a virtual pad says; it has no dead zone."""
    pad = _Pad(frame_id, axes, buttons)
    stick = (
        pad.axis(virtual_pad.X, 'x'),
        pad.axis(virtual_pad.Y, 'y'),
        pad.axis(virtual_pad.YAW, 'yaw'),
    )
    held = [pad.held(number, 'a button') for number in range(virtual_pad.FIRST_ROBOT)]
    named: dict[Choice | int, int] = {
        Choice.ALL: held[virtual_pad.ALL],
        Choice.FORMATION: held[virtual_pad.FORMATION],
        Choice.NOBODY: held[virtual_pad.RELEASE],
    }
    for robot, pressed in enumerate(buttons[virtual_pad.FIRST_ROBOT :]):
        if pressed and robot >= robots:
            raise MessageError(f"joy from '{frame_id}' selects robot {robot + 1} of {robots}")
        named[robot] = bool(pressed)
    choice = next((choice for choice, pressed in named.items() if pressed), None)
    turbo, enable = held[virtual_pad.TURBO], held[virtual_pad.ENABLE]
    e_stop, reset = held[virtual_pad.E_STOP], held[virtual_pad.RESET]
    return _hands(stick, parameters, turbo, enable, e_stop, reset, choice)


def _hands(
    stick: tuple[float, float, float],
    parameters: JoystickParameters,
    turbo: bool,
    enable: bool,
    e_stop: bool,
    reset: bool,
    choice: Choice | int | None,
) -> Hands:
    """Return the hands of a stick in [-1, 1]^3; without the dead-man button it doesn't count."""
    p = parameters
    scales = (p.scale_linear_x, p.scale_linear_y, p.scale_angular_yaw)
    if turbo:
        scales = (p.scale_linear_turbo_x, p.scale_linear_turbo_y, p.scale_angular_turbo_yaw)
    if enable:
        x, y, yaw = (share * scale for share, scale in zip(stick, scales, strict=True))
    else:
        x = y = yaw = 0.0
    return Hands(x, y, yaw, enable, e_stop, reset and not (enable or e_stop), choice)


def _past(share: float, deadzone: float) -> float:
    """Return an axis with its dead zone taken out, so that it begins at zero."""
    size = max(abs(share) - deadzone, 0.0) / (1.0 - deadzone)
    return math.copysign(size, share)


class _Pad:
    """Axes and buttons by their numbers."""

    def __init__(self, frame_id: str, axes: Sequence[float], buttons: Sequence[int]) -> None:
        self._frame_id, self._axes, self._buttons = frame_id, axes, buttons

    def axis(self, number: int, name: str) -> float:
        """Return an axis in [-1, 1], 0 if the pad has none for this."""
        if number == OFF:
            return 0.0
        if number >= len(self._axes):
            raise MessageError(self._lack('axes', len(self._axes), name, number))
        return min(max(float(self._axes[number]), -1.0), 1.0)

    def held(self, number: int, name: str) -> bool:
        """Tell whether a button is held, False if the pad has none for this."""
        if number == OFF:
            return False
        if number >= len(self._buttons):
            raise MessageError(self._lack('buttons', len(self._buttons), name, number))
        return bool(self._buttons[number])

    def _lack(self, kind: str, count: int, name: str, number: int) -> str:
        return (
            f"joy from '{self._frame_id}' has {count} {kind}, but {name} is number {number}; "
            "give the coordinator this pad's parameters, see params/joystick/"
        )
