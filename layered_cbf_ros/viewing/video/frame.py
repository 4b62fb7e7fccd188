"""All that one picture is drawn from."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.viewing.history import History
from layered_cbf_ros.viewing.sight.snapshot import Snapshot
from layered_cbf_ros.viewing.video.camera import Camera


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture to be drawn.

    Attributes:
        snapshot: What is to be seen.
        camera: From where, and how large.
        history: What was before.
        seconds: Time since the first state [s].
    """

    snapshot: Snapshot
    camera: Camera
    history: History
    seconds: float
