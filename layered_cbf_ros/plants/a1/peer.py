"""A robot's end of the wire: takes whatever comes, and answers whom it is told to."""

from __future__ import annotations

import socket

from layered_cbf_ros.plants.a1.link import bound_socket
from layered_cbf_ros.plants.a1.packets import COMMAND_BYTES

Address = tuple[str, int]


class Peer:
    """One UDP port, whose packets are taken and sent as they are."""

    def __init__(self, address: str, port: int) -> None:
        """Bind.

        Raises:
            LayeredCbfError: If the port is taken, or the address isn't ours.
        """
        self._socket: socket.socket = bound_socket(address, port, 'emulation.port')

    def receive(self) -> list[tuple[bytes, Address]]:
        """Return all packets that wait, each with its sender; never blocks."""
        packets = []
        while True:
            try:
                packets.append(self._socket.recvfrom(2 * COMMAND_BYTES))
            except BlockingIOError:
                return packets
            except OSError:  # what an earlier packet met on its way
                continue

    def send(self, packet: bytes, to: Address) -> None:
        """Send a packet; the wire may lose it."""
        try:
            self._socket.sendto(packet, to)
        except OSError:
            return

    def close(self) -> None:
        """Let the port go."""
        self._socket.close()
