"""The operator's screen as lines of text, 80 columns and 24 lines if there are no more."""

from __future__ import annotations

from layered_cbf_ros.operation.terminal_view import RobotRow, ScreenView

_BOLD, _ALARM, _DIM = '\x1b[1m', '\x1b[1;7m', '\x1b[2m'
SILENCE_S = 1.0
"""Wall time after which what was heard is old [s]."""

BAR = 8
BAR_FULL = 2.0
"""Intervention at which the bar is full [m/s^2]."""

HEADING = '  robot      m/s is plan want   nearest [m]           h [m] |u - u_des|   state'
START = 'start a run first, with the same ROS_DOMAIN_ID: scripts/demo, or the nodes'
HELP = (
    'hold a key to move, let go to stop:',
    '  w s or up down  forward, back     a d  left, right     q e or left right  turn',
    '  u o m .  curves as in teleop_twist_keyboard     + - speed     t turbo',
    '  1..9 one robot    0 all    f in formation    g give back to their goals',
    '  SPACE stop      x or ESC  EMERGENCY STOP      hold R for 2 s  reset, stand up',
    '  Ctrl-C  end; the robots stop',
    'A terminal does not tell when a key is let go: one press counts for 0.4 s, a',
    'held key until 0.15 s after its last repeat. Against a gap: xset r rate 250 30',
)


def lines_of(view: ScreenView, columns: int, rows: int) -> list[str]:
    """Return the picture; what doesn't fit is cut off, explanations first.

    Args:
        view: What to show.
        columns, rows: Size of the terminal.
    """
    styled = [*_head(view), ('', ''), ('', HEADING)]
    styled += [('', _robot_line(k, row)) for k, row in enumerate(view.robots, 1)]
    styled += [('', ''), *((_DIM, line) for line in HELP)]
    return [style + _printable(text)[:columns] for style, text in styled[:rows]]


def _head(view: ScreenView) -> list[tuple[str, str]]:
    """Return the lines on the team as a whole, each with its style."""
    pad = view.pad
    speed = f'speed {view.keys.scale:.0%}{"  turbo" if view.keys.turbo else ""}'
    held = f'forward {pad.x:+.1f}  left {pad.y:+.1f}  turn {pad.yaw:+.1f}'
    refused = f'refused last: {view.refused}' if view.refused else ''
    return [
        _state_of(view),
        ('', f'keys: {held}  {_pushed(view):<15} {speed}'),
        ('', view.note),
        ('', refused if view.silence_s is not None else START),
    ]


def _state_of(view: ScreenView) -> tuple[str, str]:
    """Return the most important line, and its style."""
    if view.silence_s is None:
        return _ALARM, f' nobody is there: no coordinator on ROS_DOMAIN_ID {view.domain} '
    if view.silence_s > SILENCE_S:
        words = f'nothing heard of the coordinator for {view.silence_s:.0f} s: paused, or ended'
        return _ALARM, f' {words} '
    time = f'time of the run {view.stamp_s:.1f} s'
    if view.is_stopped:
        return _ALARM, f' EMERGENCY STOP: robots sit down; hold R to reset.   {time} '
    who = 'this keyboard' if view.operator == view.own_name else view.operator or 'nobody'
    return _BOLD, f'{who} steers      {time}'


def _pushed(view: ScreenView) -> str:
    """Return in words what is held on the keyboard."""
    pad = view.pad
    named = {
        'E-STOP': pad.e_stop,
        'reset': pad.reset,
        'moving': pad.enable,
        'all': pad.select_all,
        'formation': pad.formation,
        'give back': pad.release,
        'one robot': pad.robot is not None,
    }
    return next((f'[{name}]' for name, held in named.items() if held), '')


def _robot_line(number: int, row: RobotRow) -> str:
    """Return the line of a robot."""
    speeds = ' '.join(_figure(v, 4) for v in (row.measured, row.planned, row.desired))
    key = str(number) if number <= 9 else ' '
    return (
        f'{key} {row.name:<12.12} {speeds} {_figure(row.distance, 6)} {row.neighbour:<13.13} '
        f'{_figure(row.h, 5)} {bar(row.intervention)} {_figure(row.intervention, 5)} {row.state}'
    )


def bar(intervention: float | None) -> str:
    """Return |u - u_desired| [m/s^2] as a bar; a filter that does something shows a sign."""
    share = 0.0 if intervention is None else intervention / BAR_FULL
    if not share > 0.005:
        return '.' * BAR
    filled = min(max(round(share * BAR), 1), BAR)
    return '#' * filled + '.' * (BAR - filled)


def _figure(value: float | None, width: int) -> str:
    return f'{"-":>{width}}' if value is None else f'{value:{width}.2f}'


def _printable(text: str) -> str:
    """Return a text without anything that a terminal would obey."""
    return ''.join(c if ' ' <= c <= '~' else '?' for c in text)
