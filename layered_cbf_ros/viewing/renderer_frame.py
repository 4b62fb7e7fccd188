"""All that one picture is drawn from."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.viewing.renderer_camera import Camera
from layered_cbf_ros.viewing.renderer_history import History
from layered_cbf_ros.viewing.snapshot import Snapshot


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
