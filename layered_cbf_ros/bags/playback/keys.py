"""Keys of a terminal, from the bytes that it sends for them."""

from __future__ import annotations

from enum import Enum


class Key(Enum):
    """What a key asks for."""

    PAUSE = 'space'
    STEP = 'right arrow'
    FASTER = 'up arrow'
    SLOWER = 'down arrow'
    QUIT = 'q'


ESCAPE = 0x1B
INTRODUCERS = b'[O'  # normal and application mode of the arrow keys
SIMPLE = {ord(' '): Key.PAUSE, ord('q'): Key.QUIT, 0x03: Key.QUIT, 0x04: Key.QUIT}
ARROWS = {ord('C'): Key.STEP, ord('A'): Key.FASTER, ord('B'): Key.SLOWER}


class KeyDecoder:
    """Finds keys in what was typed; an arrow's bytes may come apart."""

    def __init__(self) -> None:
        self._sequence = b''

    def feed(self, data: bytes) -> list[Key]:
        """Return the keys that are complete; ignore all that have no meaning here."""
        found = []
        for byte in data:
            key = self._take(byte)
            if key is not None:
                found.append(key)
        return found

    def _take(self, byte: int) -> Key | None:
        """Take one byte; return the key that it completes, if it does."""
        if byte == ESCAPE:
            self._sequence = bytes([byte])
            return None
        if not self._sequence:
            return SIMPLE.get(byte)
        if len(self._sequence) == 1 and byte in INTRODUCERS:
            self._sequence += bytes([byte])
            return None
        is_alone = len(self._sequence) == 1
        is_plain = self._sequence[1:] in (b'[', b'O')
        if is_alone:  # Escape itself was pressed, then another key
            self._sequence = b''
            return SIMPLE.get(byte)
        if 0x40 <= byte <= 0x7E:  # the end of a sequence
            self._sequence = b''
            return ARROWS.get(byte) if is_plain else None
        self._sequence += bytes([byte])  # a number: an arrow with Shift, a function key
        return None
