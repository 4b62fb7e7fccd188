"""A robot's end of the wire: takes whatever comes, and answers whom it is told to."""

from __future__ import annotations

import socket

from layered_cbf_ros.plants.a1.link import bound_socket
from layered_cbf_ros.plants.a1.packets import COMMAND_BYTES

Address = tuple[str, int]


MOST_PACKETS = 64
"""Taken in one call, so that a flood can't stop the world."""


class Peer:
    """One UDP port, whose packets are taken and sent as they are."""

    def __init__(self, address: str, port: int) -> None:
        """Bind.

        Raises:
            LayeredCbfError: If the port is taken, or the address isn't ours.
        """
        self._socket: socket.socket = bound_socket(address, port, 'emulation.port')

    def receive(self) -> list[tuple[bytes, Address]]:
        """Return the packets that wait, each with its sender; never blocks."""
        packets = []
        for _ in range(MOST_PACKETS):
            try:
                packets.append(self._socket.recvfrom(2 * COMMAND_BYTES))
            except BlockingIOError:
                break
            except OSError:  # what an earlier packet met on its way
                continue
        return packets

    def send(self, packet: bytes, to: Address) -> None:
        """Send a packet; the wire may lose it."""
        try:
            self._socket.sendto(packet, to)
        except OSError:
            return

    def close(self) -> None:
        """Let the port go."""
        self._socket.close()
