"""A virtual pad whose buttons are the keys of a terminal.

A terminal tells that a key was pressed, again and again while it is held, but not that it
was let go. So a key counts as held for a while after it came: longer after the first time,
for a terminal waits before it repeats a key, and shortly once it repeats.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from layered_cbf_ros.operation import keyboard
from layered_cbf_ros.operation.keyboard import MOTIONS, MS, Motion
from layered_cbf_ros.operation.virtual_pad import PadState

FIRST_NS = 400 * MS
"""How long a key counts as held after it was pressed [ns]."""

REPEAT_NS = 150 * MS
"""How long it counts as held after a repeat [ns]."""

PUSH_NS = 200 * MS
"""How long a button that needn't be held is sent: several messages [ns]."""

E_STOP_NS = 1000 * MS
"""How long an emergency stop is sent: should messages be lost, many are left [ns]."""

STEP, LEAST = 0.1, 0.1
_STILL: Motion = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class HeldKeys:
    """The keys that count as held; times are of a clock that never goes back [ns].

    Attributes:
        key: The key that is held: one of MOTIONS, or the reset key; '' for none.
        key_until_ns: When it counts as let go.
        button: The button that was pushed last: its field in PadState; '' for none.
        robot: The robot that was chosen by its number, if that was pushed last.
        button_until_ns: When it counts as let go.
        e_stop_until_ns: When the emergency stop counts as let go.
        scale: Share of the full stick.
        turbo: Whether the faster scales are chosen.
    """

    key: str = ''
    key_until_ns: int = 0
    button: str = ''
    robot: int | None = None
    button_until_ns: int = 0
    e_stop_until_ns: int = 0
    scale: float = 1.0
    turbo: bool = False

    def after(self, key: str, now_ns: int, robots: int) -> HeldKeys:
        """Return what is held after a key has come.

        Args:
            key: As `find_keys` names it.
            now_ns: When it came [ns].
            robots: How many robots there are to choose from.
        """
        if key in keyboard.EMERGENCY:
            return replace(self, key='', button='', e_stop_until_ns=now_ns + E_STOP_NS)
        if key in keyboard.STOP:
            return replace(self, key='')
        if key in MOTIONS or key == keyboard.RESET:
            # nobody moves by the reset key: a late repeat need not make a person begin anew
            repeated = key in MOTIONS and key == self.key and now_ns < self.key_until_ns
            lasts_ns = REPEAT_NS if repeated else FIRST_NS
            return replace(self, key=key, key_until_ns=now_ns + lasts_ns)
        if key in keyboard.FASTER + keyboard.SLOWER:
            step = STEP if key in keyboard.FASTER else -STEP
            return replace(self, scale=min(max(round(self.scale + step, 1), LEAST), 1.0))
        if key == keyboard.TURBO:
            return replace(self, turbo=not self.turbo)
        return self._pushed(key, now_ns, robots)

    def pad(self, now_ns: int) -> PadState:
        """Return the pad as it is held at a time."""
        key = self.key if now_ns < self.key_until_ns else ''
        button = self.button if now_ns < self.button_until_ns else ''
        x, y, yaw = (self.scale * share for share in MOTIONS.get(key, _STILL))
        return PadState(
            x=x,
            y=y,
            yaw=yaw,
            enable=key in MOTIONS,
            turbo=self.turbo and key in MOTIONS,
            e_stop=now_ns < self.e_stop_until_ns,
            reset=key == keyboard.RESET,
            select_all=button == 'select_all',
            formation=button == 'formation',
            release=button == 'release',
            robot=self.robot if button == 'robot' else None,
        )

    def _pushed(self, key: str, now_ns: int, robots: int) -> HeldKeys:
        """Return what is held after a button that chooses robots."""
        robot = None
        if key in keyboard.ALL:
            button = 'select_all'
        elif key == keyboard.FORMATION:
            button = 'formation'
        elif key == keyboard.RELEASE:
            button = 'release'
        elif key.isdecimal() and int(key) <= robots:
            button, robot = 'robot', int(key) - 1
        else:
            return self
        return replace(self, button=button, robot=robot, button_until_ns=now_ns + PUSH_NS)


def of_team(pad: PadState, places: tuple[int, ...]) -> PadState:
    """Return the pad with the chosen robot's place in the team.

    Args:
        pad: Its robot counts among the robots on the screen.
        places: The place in the team of each of these.
    """
    return pad if pad.robot is None else replace(pad, robot=places[pad.robot])
