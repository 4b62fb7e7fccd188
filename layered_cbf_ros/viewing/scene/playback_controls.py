"""The controls of a bag in the page: slider, play, speed, and jumps."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import viser

from layered_cbf_ros.viewing.sight.bag_sight import BagSight

SPEEDS = ('0.1x', '0.25x', '0.5x', '1x', '2x', '4x')
STEP_S = 0.02


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which instant of a bag is to be shown.

    Attributes:
        seconds: Time since the first state [s].
        is_jump: Whether it is elsewhere than the playback would have come to.
    """

    seconds: float
    is_jump: bool


class PlaybackControls:
    """Follows the time of a bag by what people do in the page; they share one time."""

    def __init__(self, gui: viser.GuiApi, sight: BagSight) -> None:
        self._duration = sight.duration
        self._lock = threading.Lock()
        self._seconds, self._is_jump, self._is_playing = 0.0, True, False
        end = max(sight.duration, STEP_S)
        self._slider = gui.add_slider('time [s]', 0.0, end, STEP_S, 0.0, order=1.0)
        self._play = gui.add_button('play', order=2.0)
        self._speed = gui.add_dropdown('speed', SPEEDS, initial_value='1x', order=3.0)
        self._slider.on_update(self._on_slider)
        self._play.on_click(lambda _: self._toggle())
        self._moments = {f'{m.name}, {m.seconds:.1f} s': m.seconds for m in sight.moments}
        for label in self._moments:
            button = gui.add_button(label, order=4.0, color='gray')
            button.on_click(lambda event: self._jump(self._moments[event.target.label]))

    def advance(self, elapsed: float) -> Wanted:
        """Return what to show after some wall time [s]."""
        speed = float(self._speed.value.removesuffix('x'))
        with self._lock:
            if self._is_playing:
                self._seconds = min(self._seconds + speed * elapsed, self._duration)
                if self._seconds >= self._duration:
                    self._is_playing = False
            wanted = Wanted(self._seconds, self._is_jump)
            self._is_jump, is_playing = False, self._is_playing
        value = round(wanted.seconds / STEP_S) * STEP_S
        self._slider.value = value  # type: ignore[misc]  # viser types it as read-only
        self._play.label = 'hold' if is_playing else 'play'
        return wanted

    def _on_slider(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        """Go where a person moved the slider; our own moves of it tell of no person."""
        if event.client is not None:
            self._jump(event.target.value)

    def _toggle(self) -> None:
        with self._lock:
            if not self._is_playing and self._seconds >= self._duration:
                self._seconds, self._is_jump = 0.0, True
            self._is_playing = not self._is_playing

    def _jump(self, seconds: float) -> None:
        with self._lock:
            self._seconds, self._is_jump = seconds, True
