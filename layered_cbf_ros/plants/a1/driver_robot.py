"""One robot, as its driver sees it: what it told last, and a voice that may be muted."""

from __future__ import annotations

from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.a1.frames import LowCommand, LowState
from layered_cbf_ros.plants.a1.link import Link
from layered_cbf_ros.plants.a1.packets import CommandPacker
from layered_cbf_ros.plants.a1.remote import pressed_buttons


class DriverRobot:
    """Keeps the newest state of a robot, and sends frames unless it must not.

    Attributes:
        state: The newest, None before the first.
        state_ns: When it came [ns].
        buttons: What is pressed on its remote control.
    """

    def __init__(self, parameters: DriverParameters) -> None:
        """Open the link.

        Raises:
            LayeredCbfError: If the port is taken.
        """
        self._link = Link(parameters.address, parameters.port, parameters.local_port)
        self._packer = CommandPacker(parameters.torque_limit)
        self._mute = parameters.listen_only or parameters.dry_run
        self._remote = b''
        self.state: LowState | None = None
        self.state_ns = 0
        self.buttons: frozenset[str] = frozenset()

    def receive(self, now_ns: int) -> LowState | None:
        """Return what came since the last call, its newest; None if nothing did.

        Args:
            now_ns: The present time [ns].
        """
        state = self._link.receive()
        if state is None:
            return None
        if state.remote != self._remote:
            self._remote, self.buttons = state.remote, pressed_buttons(state.remote)
        self.state, self.state_ns = state, now_ns
        return state

    def send(self, command: LowCommand) -> None:
        """Send a frame; not a single one in a dry run, or of who only listens."""
        if not self._mute:
            self._link.send(self._packer.pack(command))

    def counts(self) -> dict[str, str]:
        """Return how many packets went and came, and how many were refused and why."""
        link = self._link
        refused = ', '.join(f'{kind} {count}' for kind, count in sorted(link.refused.items()))
        return {
            'states_received': str(link.received),
            'states_refused': refused,
            'frames_sent': str(link.sent),
            'frames_unsent': str(link.unsent),
        }

    def close(self) -> None:
        """Let the port go."""
        self._link.close()
