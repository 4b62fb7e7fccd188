"""What the front asks of the node graph."""

from __future__ import annotations

from typing import Protocol

from layered_cbf_ros.operation.virtual_pad import PadState


class Team(Protocol):
    """Whoever passes the operator's wishes on."""

    def operate(self, pad: PadState) -> None:
        """Send what is held on the virtual pad."""
