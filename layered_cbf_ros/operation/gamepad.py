"""A gamepad of this computer, read through Linux's joystick interface (/dev/input/js0 ...).

Axes and buttons are numbered as the kernel numbers them, which is also joy_node's order where
SDL reads the pad through the kernel's driver; signs are joy_node's: left and up are positive.
"""

from __future__ import annotations

import array
import contextlib
import fcntl
import os
import struct
from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.interfaces import NS_PER_S

FOLDER = Path('/dev/input')
EVENT = struct.Struct('=IhBB')
"""Time of an event [ms], value, kind, number."""

BUTTON, AXIS, INITIAL = 0x01, 0x02, 0x80
FULL = 32767
MANY = 64
NAME_SIZE = 128
_GET_AXES, _GET_BUTTONS = 0x80016A11, 0x80016A12  # JSIOCGAXES, JSIOCGBUTTONS
_GET_NAME = 0x80006A13 | NAME_SIZE << 16  # JSIOCGNAME(NAME_SIZE)
_LOOK_AGAIN_NS = NS_PER_S // 2


@dataclass(frozen=True, slots=True)
class Sticks:
    """What is held on a pad.

    Attributes:
        axes: Each in [-1, 1], left and up positive.
        buttons: 1 where pressed.
        cut: The begin of an event whose other bytes haven't come yet.
    """

    axes: tuple[float, ...] = ()
    buttons: tuple[int, ...] = ()
    cut: bytes = b''


def moved(sticks: Sticks, data: bytes) -> Sticks:
    """Return what is held after the events of some bytes.

    Args:
        sticks: What was held; it grows by axes and buttons that were not known.
        data: Events of the joystick interface, 8 bytes each, in the computer's byte order.
    """
    data = sticks.cut + data
    whole = len(data) - len(data) % EVENT.size
    axes, buttons = list(sticks.axes), list(sticks.buttons)
    for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
        if kind & ~INITIAL == AXIS:
            axes += [0.0] * (number + 1 - len(axes))
            axes[number] = -max(value, -FULL) / FULL or 0.0
        elif kind & ~INITIAL == BUTTON:
            buttons += [0] * (number + 1 - len(buttons))
            buttons[number] = int(value != 0)
    return Sticks(tuple(axes), tuple(buttons), data[whole:])


class Gamepad:
    """One pad, that may be unplugged and plugged in again.

    Attributes:
        path: The device that is read, None while there is none.
        name: What the pad calls itself.
        sticks: What is held on it.
    """

    def __init__(self, wanted: Path | None = None) -> None:
        """Prepare to read a device, the first one there is if None is given."""
        self._wanted = wanted
        self._fd = -1
        self._next_look_ns = 0
        self.path: Path | None = None
        self.name = ''
        self.sticks = Sticks()

    def poll(self, now_ns: int) -> str:
        """Take what the pad has sent; return a line on its coming or going, '' if there is none.

        Args:
            now_ns: Time of a clock that never goes back [ns].

        Raises:
            LayeredCbfError: If it is there but may not be read.
        """
        if self._fd < 0:
            return self._look(now_ns)
        while True:
            try:
                data = os.read(self._fd, MANY * EVENT.size)
            except BlockingIOError:
                return ''
            except OSError:
                data = b''
            if not data:
                gone = f'{self.path} ({self.name}) is unplugged: robots stop; waiting for it'
                self.close()
                return gone
            self.sticks = moved(self.sticks, data)

    def close(self) -> None:
        """Let go of the device."""
        if self._fd >= 0:
            os.close(self._fd)
        self._fd, self.path, self.sticks = -1, None, Sticks()

    @property
    def frame_id(self) -> str:
        """Return the name of the pad as a source of Joy messages."""
        return f'joy/{self.path.name}' if self.path else ''

    def described(self) -> str:
        """Return what is held, by numbers: so a pad tells how it is to be set up."""
        axes = ' '.join(f'{value:+.1f}' for value in self.sticks.axes)
        held = ' '.join(str(k) for k, pressed in enumerate(self.sticks.buttons) if pressed)
        return f'{self.path}: axes {axes}  buttons held: {held or "none"}'

    def _look(self, now_ns: int) -> str:
        if now_ns < self._next_look_ns:
            return ''
        first = self._next_look_ns == 0
        self._next_look_ns = now_ns + _LOOK_AGAIN_NS
        found = sorted(FOLDER.glob('js*'), key=lambda path: (len(path.name), path.name))
        path = self._wanted or next(iter(found), None)
        if path is None or not path.exists():
            known = ', '.join(map(str, found)) or 'none'
            wanted = self._wanted or FOLDER / 'js*'
            return f'no gamepad at {wanted} (there: {known}); waiting for it' if first else ''
        try:
            self._fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except PermissionError:
            raise LayeredCbfError(
                f"{path} may not be read; add yourself to its group with 'sudo usermod -aG "
                "input $USER' and log in again"
            ) from None
        except OSError:
            return ''  # it goes just now, or comes: look again
        self.path, self.name = path, _name_of(self._fd)
        self.sticks = Sticks(
            (0.0,) * _count(self._fd, _GET_AXES), (0,) * _count(self._fd, _GET_BUTTONS)
        )
        return f'reading {path} ({self.name})'


def _count(fd: int, request: int) -> int:
    """Ask the device for a number; 0 if it has none to tell: then its events do."""
    answer = array.array('B', [0])
    with contextlib.suppress(OSError):
        fcntl.ioctl(fd, request, answer)
    return answer[0]


def _name_of(fd: int) -> str:
    answer = array.array('B', bytes(NAME_SIZE))
    with contextlib.suppress(OSError):
        fcntl.ioctl(fd, _GET_NAME, answer)
    return answer.tobytes().partition(b'\0')[0].decode('utf-8', 'replace') or 'gamepad'
