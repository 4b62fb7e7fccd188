"""A driver's end of the wire: one robot's UDP packets, and what was wrong with others."""

from __future__ import annotations

import errno
import socket
from collections import Counter

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.plants.a1.frames import LowState
from layered_cbf_ros.plants.a1.packets import STATE_BYTES, FrameError, unpack_state

HALF_ROUND = 1 << 31  # of the robot's 32-bit clock
BEGUN_ANEW = 50
"""So many older states in a row, none older than the one before: the robot was restarted."""
MOST_PACKETS = 64
"""Taken in one call: a stranger who floods the port must not keep the driver from its cycle."""


class TickOrder:
    """Tells new states from old ones by the robot's own clock, whatever its unit is."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._older, self._row = 0, 0

    def accepts(self, tick: int) -> bool:
        """Tell whether a state is not older than all before; its clock may go round."""
        if self._last is None or _behind(self._last, tick) < HALF_ROUND:
            self._last, self._row = tick, 0
            return True
        gap = _behind(self._older, tick)
        if self._row and gap == 0:  # the same again: its clock may be coarse
            return False
        self._older, self._row = tick, self._row + 1 if self._row and gap < HALF_ROUND else 1
        if self._row < BEGUN_ANEW:
            return False
        self._last, self._row = tick, 0
        return True


def _behind(earlier: int, later: int) -> int:
    return (later - earlier) & 0xFFFFFFFF


class Link:
    """Sends packets to one robot, and takes those that come from it and from nobody else.

    Attributes:
        refused: How many packets were refused, by kind: 'address', 'length', 'checksum',
            'empty', 'not_finite', 'replayed', 'older'.
        received, sent, unsent: How many packets were good, went, or could not go.
    """

    def __init__(self, address: str, port: int, local_port: int) -> None:
        """Bind.

        Args:
            address, port: Of the robot.
            local_port: Ours.

        Raises:
            LayeredCbfError: If our port can't be had.
        """
        self._robot = (address, port)
        self._socket = bound_socket('', local_port, 'local_port')
        self._order = TickOrder()
        self._newest: bytes | None = None
        self.refused: Counter[str] = Counter()
        self.received = self.sent = self.unsent = 0

    def receive(self) -> LowState | None:
        """Return the newest state that waits, None if there is none; never blocks."""
        newest = None
        for _ in range(MOST_PACKETS):
            try:
                data, sender = self._socket.recvfrom(2 * STATE_BYTES)
            except BlockingIOError:
                break
            except OSError:  # what an earlier packet met on its way
                continue
            state = self._accepted(data, sender)
            newest = newest if state is None else state
        return newest

    def send(self, packet: bytes) -> None:
        """Send a packet; one that can't go is counted."""
        try:
            self._socket.sendto(packet, self._robot)
            self.sent += 1
        except OSError:
            self.unsent += 1

    def close(self) -> None:
        """Let the port go."""
        self._socket.close()

    def _accepted(self, data: bytes, sender: tuple[str, int]) -> LowState | None:
        """Return the state of a packet, None if it is refused and counted."""
        try:
            if sender != self._robot:
                raise FrameError('address', f'packet from {sender[0]}:{sender[1]}')
            if data == self._newest:
                raise FrameError('replayed', 'state came again')
            state = unpack_state(data)
            if not self._order.accepts(state.tick):
                raise FrameError('older', 'state is older than the one before')
        except FrameError as error:
            self.refused[error.kind] += 1
            return None
        self._newest = data
        self.received += 1
        return state


def bound_socket(address: str, port: int, field: str) -> socket.socket:
    """Return a UDP socket that never blocks.

    Args:
        address, port: Where it listens; '' is every address of this computer.
        field: What a person has set the port by.

    Raises:
        LayeredCbfError: If somebody else has the port, or the address isn't ours.
    """
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.setblocking(False)
    try:
        bound.bind((address, port))
    except OSError as error:
        bound.close()
        where = f'{field} {port}: UDP port {port} of {address or "every address"}'
        if error.errno != errno.EADDRINUSE:
            raise LayeredCbfError(
                f"{where} can't be had ({error.strerror}); give an address and a port of this "
                'computer'
            ) from None
        raise LayeredCbfError(
            f'{where} is not free; choose another, or end the program that has it'
        ) from None
    return bound
