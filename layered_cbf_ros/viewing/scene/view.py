"""Everything that the page shows of a run: the 3D scene, and the panels beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import viser

from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.viewing.scene.cameras import NOBODY, Cameras
from layered_cbf_ros.viewing.scene.plots import Plots
from layered_cbf_ros.viewing.scene.scene import Scene, Switch
from layered_cbf_ros.viewing.scene.words import node_table, status_words, waiting_words
from layered_cbf_ros.viewing.scene.world import build_ground
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

BRAND = (0, 114, 178)
HOLD, STEP, GO_ON = 'hold', 'step', 'go on'
MAIN_WIDTH, PLOTS_WIDTH = 260, 280
WORDS_PERIOD_S = 0.2
"""Words are written anew so often [s] of wall time."""


@dataclass(frozen=True, slots=True)
class TimeButtons:
    """What a person can do with the time of a live run.

    Attributes:
        pause: Takes whether the time shall be held; returns what came of it, for a person.
        step: Lets the held time go on a little; returns the same.
    """

    pause: Callable[[bool], str]
    step: Callable[[], str]


class View:
    """Shows one run after the other on a viser server."""

    def __init__(self, server: viser.ViserServer, buttons: TimeButtons | None = None) -> None:
        """Make an empty page.

        Args:
            server: Where.
            buttons: Of a live run that can be paused.
        """
        self._server, self._buttons = server, buttons
        self._scene: Scene | None = None
        self._next_words = 0.0
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=BRAND, control_width='small'
        )
        build_ground(server.scene)
        self._status = server.gui.add_html(waiting_words('a run'))

    @property
    def is_watched(self) -> bool:
        """Return whether anybody has the page open."""
        return bool(self._server.get_clients())

    @property
    def wants_forces(self) -> bool:
        """Return whether foot forces are shown."""
        return self._scene is not None and self._scene.wants_forces

    def wait_for(self, missing: str) -> None:
        """Say what there is nothing to see without."""
        self._status.content = waiting_words(missing)

    def open(self, scenario: Scenario) -> None:
        """Make the page of a run; what was shown before goes."""
        gui, names = self._server.gui, [robot.name for robot in scenario.robots]
        gui.reset()
        self._scene = Scene(self._server.scene, scenario)
        gui.set_panel_label(scenario.name)
        self._status = gui.add_html(waiting_words('the first state'), order=0.0)
        first = names[0] if len(names) == 1 else NOBODY
        followed = gui.add_dropdown('follow', (NOBODY, *names), initial_value=first, order=5.0)
        self._cameras = Cameras(self._server, followed)
        with gui.add_folder('more', expand_by_default=False, order=6.0):
            if self._buttons is not None:
                self._add_buttons(self._buttons)
            self._add_switches(self._scene)
        panel = gui.add_panel()
        with panel.add_tab('plots'):
            self._plots = Plots(gui, names)
        with panel.add_tab('nodes'):
            self._nodes = gui.add_html(node_table(()))
        gui.main_panel.float(x=12.0, y=12.0, width=MAIN_WIDTH)
        panel.dock_right()
        panel.set_width(PLOTS_WIDTH)

    def show(self, snapshot: Snapshot, before: Sequence[Snapshot] = ()) -> None:
        """Draw an instant.

        Args:
            snapshot: The instant, of the run that was opened.
            before: After a jump in time: the instants before it, for the curves.
        """
        if self._scene is None:
            return
        with self._server.atomic():
            for earlier in before:
                self._scene.draw_trails(earlier)
            self._scene.draw(snapshot)
            if before:
                self._plots.refill(before)
            self._plots.draw(snapshot)
            self._write(snapshot)
        self._cameras.draw(snapshot)
        self._server.flush()

    def _write(self, snapshot: Snapshot) -> None:
        """Write the words anew, when it is time to."""
        now = time.monotonic()
        if now < self._next_words:
            return
        self._next_words = now + WORDS_PERIOD_S
        self._status.content = status_words(snapshot)
        self._nodes.content = node_table(snapshot.nodes)

    def _add_buttons(self, buttons: TimeButtons) -> None:
        """Add the buttons that hold the simulated time."""
        group = self._server.gui.add_button_group('time', (HOLD, STEP, GO_ON), order=1.0)

        @group.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            wish = event.target.value
            self._answer(buttons.step() if wish == STEP else buttons.pause(wish == HOLD))

    def _answer(self, text: str) -> None:
        """Tell every visitor what came of a wish, if there is anything to tell."""
        for client in self._server.get_clients().values() if text else ():
            client.add_notification('time', text, auto_close_seconds=4.0)

    def _add_switches(self, scene: Scene) -> None:
        for switch in scene.switches:
            _connect(self._server.gui.add_checkbox(switch.label, switch.is_on), switch)


def _connect(box: viser.GuiCheckboxHandle, switch: Switch) -> None:
    """Let a box show and hide what it stands for."""
    box.on_update(lambda event: switch.turn(event.target.value))
