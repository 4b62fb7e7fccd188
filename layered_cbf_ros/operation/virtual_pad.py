"""The joystick of our own programs: one layout, whatever pad the coordinator is set up for.

`teleop` and `viewer` send sensor_msgs/Joy with a frame_id that begins with FRAME, and the
coordinator reads those by this layout. All other Joy messages are read by its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

FRAME = 'virtual_pad'
"""The frame_id of a virtual pad is this, a slash, and who sends: `virtual_pad/teleop`."""

X, Y, YAW = range(3)
ENABLE, TURBO, E_STOP, RESET, ALL, FORMATION, RELEASE = range(7)
FIRST_ROBOT = 8
"""The button that selects the first robot; the next ones select the next robots."""


@dataclass(frozen=True, slots=True)
class PadState:
    """What is held on a virtual pad at one moment.

    Attributes:
        x, y, yaw: Stick forward, to the left, turning left, each in [-1, 1].
        enable: The dead-man button: without it nobody moves.
        turbo: Faster scales.
        e_stop: Stops everybody; it stays so until reset.
        reset: To be held alone for a second: the stop ends, robots stand up.
        select_all: Steer all robots, each by its own heading.
        formation: Steer all robots with the same velocity, by the first one's heading.
        release: Give all robots back to their own goals.
        robot: Index of the robot to steer alone, None not to choose one now.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    enable: bool = False
    turbo: bool = False
    e_stop: bool = False
    reset: bool = False
    select_all: bool = False
    formation: bool = False
    release: bool = False
    robot: int | None = None

    def axes(self) -> list[float]:
        """Return the axes of the Joy message."""
        return [float(self.x), float(self.y), float(self.yaw)]

    def buttons(self, robots: int) -> list[int]:
        """Return the buttons of the Joy message, for a team of so many robots."""
        held = [0] * (FIRST_ROBOT + robots)
        held[ENABLE], held[TURBO] = int(self.enable), int(self.turbo)
        held[E_STOP], held[RESET] = int(self.e_stop), int(self.reset)
        held[ALL], held[FORMATION] = int(self.select_all), int(self.formation)
        held[RELEASE] = int(self.release)
        if self.robot is not None:
            held[FIRST_ROBOT + self.robot] = 1
        return held
