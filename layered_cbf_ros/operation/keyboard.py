"""Keys of a terminal, from the bytes that it sends for them, and what they ask for."""

from __future__ import annotations

from dataclasses import dataclass

MS = 1_000_000
ESCAPE_NS = 60 * MS
"""How long the rest of an arrow key's bytes may take; then Escape itself was pressed [ns]."""

ESCAPE, SPACE, UP, DOWN, LEFT, RIGHT = 'escape', 'space', 'up', 'down', 'left', 'right'
_INTRODUCERS = b'[O'  # normal and application mode of the arrow keys
_ARROWS = {ord('A'): UP, ord('B'): DOWN, ord('C'): RIGHT, ord('D'): LEFT}
_ESC = 0x1B
_LONGEST = 32  # bytes that are kept of a sequence; only its first ones tell

Motion = tuple[float, float, float]
"""Stick forward, to the left, turning left, each in [-1, 1]."""

MOTIONS: dict[str, Motion] = {
    **{'w': (1, 0, 0), 's': (-1, 0, 0), 'a': (0, 1, 0), 'd': (0, -1, 0)},
    **{'q': (0, 0, 1), 'e': (0, 0, -1)},
    **{UP: (1, 0, 0), DOWN: (-1, 0, 0), LEFT: (0, 0, 1), RIGHT: (0, 0, -1)},
    # as in teleop_twist_keyboard; capital letters go sideways
    **{'u': (1, 0, 1), 'i': (1, 0, 0), 'o': (1, 0, -1), 'j': (0, 0, 1), 'l': (0, 0, -1)},
    **{'m': (-1, 0, -1), ',': (-1, 0, 0), '.': (-1, 0, 1)},
    **{'U': (1, 1, 0), 'I': (1, 0, 0), 'O': (1, -1, 0), 'J': (0, 1, 0), 'L': (0, -1, 0)},
    **{'M': (-1, 1, 0), '<': (-1, 0, 0), '>': (-1, -1, 0)},
}

STOP = (SPACE, 'k', 'K')
EMERGENCY = (ESCAPE, 'x', 'X')
RESET = 'R'
ALL = ('0', '*')
FORMATION, RELEASE, TURBO = 'f', 'g', 't'
FASTER, SLOWER = ('+', '='), ('-', '_')


@dataclass(frozen=True, slots=True)
class KeyBytes:
    """The begin of a key whose other bytes may still come.

    Attributes:
        begun: Its bytes so far, from Escape on; empty if there are none.
        since_ns: When its last byte came [ns].
    """

    begun: bytes = b''
    since_ns: int = 0


def find_keys(before: KeyBytes, data: bytes, now_ns: int) -> tuple[KeyBytes, list[str]]:
    """Return what is left unfinished, and the keys that are complete.

    A printable key stands for itself, others have names. What this program doesn't know
    (function keys, mouse reports, letters of other alphabets) gives nothing.

    Args:
        before: What was left the last time.
        data: The bytes that came since; call it with none as well, for Escape's sake.
        now_ns: Time [ns].
    """
    begun, keys = before.begun, []
    if begun and now_ns - before.since_ns > ESCAPE_NS:
        keys += [ESCAPE] if len(begun) == 1 else []
        begun = b''
    for byte in data:
        begun, found = _take(begun, byte)
        keys += found
    return KeyBytes(begun, now_ns if data else before.since_ns), keys


def _take(begun: bytes, byte: int) -> tuple[bytes, list[str]]:
    """Take one byte; return the sequence that is still open, and the keys it completes."""
    if not begun:
        if byte == _ESC:
            return bytes([byte]), []
        if byte == ord(' '):
            return b'', [SPACE]
        return b'', [chr(byte)] if 0x20 < byte < 0x7F else []
    if len(begun) == 1:
        if byte in _INTRODUCERS:
            return begun + bytes([byte]), []
        # Escape was pressed by itself, and something after it; to stop once too often is safe
        open_now, more = _take(b'', byte)
        return open_now, [ESCAPE, *more]
    if byte == _ESC:  # noise, and then a new sequence
        return bytes([byte]), []
    if 0x40 <= byte <= 0x7E:  # the end of a sequence
        plain = len(begun) == 2 and byte in _ARROWS
        return b'', [_ARROWS[byte]] if plain else []
    return (begun + bytes([byte]))[:_LONGEST], []
