"""What an operator does at a terminal or a gamepad is what the Joy messages say, and no more."""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path

import numpy as np
import pytest

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.interfaces import PlannedMotion, VelocityCommand
from layered_cbf_ros.operation.gamepad import Sticks, moved
from layered_cbf_ros.operation.joystick import read_joy
from layered_cbf_ros.operation.keyboard import ESCAPE_NS, MOTIONS, KeyBytes, find_keys
from layered_cbf_ros.operation.parameters import OFF, JoystickParameters
from layered_cbf_ros.operation.terminal_options import parse, places_of
from layered_cbf_ros.operation.terminal_pad import FIRST_NS, REPEAT_NS, HeldKeys, of_team
from layered_cbf_ros.operation.terminal_screen import bar, lines_of
from layered_cbf_ros.operation.terminal_view import (
    Heard,
    ScreenView,
    row_of,
    view_of,
    with_desired,
    with_tracks,
    with_words,
)
from layered_cbf_ros.operation.virtual_pad import PadState
from layered_cbf_ros.parameters import from_file

MS, S = 1_000_000, 1_000_000_000
ROOT = Path(__file__).resolve().parents[1]


def typed(data, pause_ns=S):
    """Return the keys that some bytes stand for, when nothing follows them."""
    rest, keys = find_keys(KeyBytes(), data, 0)
    return keys + find_keys(rest, b'', pause_ns)[1]


@pytest.mark.parametrize(
    ('data', 'keys'),
    [
        (b'wx R', ['w', 'x', 'space', 'R']),
        (b'\x1b[A\x1b[D', ['up', 'left']),
        (b'\x1bOB\x1bOC', ['down', 'right']),
        (b'\x1b', ['escape']),
        (b'\x1b\x1b', ['escape', 'escape']),
        (b'\x1bw', ['escape', 'w']),
        (b'\x1b[1;2A', []),  # with Shift
        (b'\x1b[3~\x1b[15~', []),  # Delete, F5
        (b'\x1b[<35;10;7M', []),  # a mouse
        ('wöw'.encode(), ['w', 'w']),
        (b'\r\n\t\x7f', []),
        (b'\x1b[' + b'1' * 100 + b'\x1b[A', ['up']),
    ],
)
def test_bytes_of_a_terminal_are_found_to_be_keys(data, keys):
    assert typed(data) == keys


def test_an_arrow_that_comes_apart_is_no_emergency_stop_but_escape_alone_is():
    rest, keys = find_keys(KeyBytes(), b'\x1b', 0)
    assert keys == []
    rest, keys = find_keys(rest, b'[', ESCAPE_NS // 2)
    assert find_keys(rest, b'A', ESCAPE_NS)[1] == ['up']
    assert typed(b'\x1b', ESCAPE_NS) == []
    assert typed(b'\x1b', ESCAPE_NS + 1) == ['escape']


def test_noise_on_the_line_moves_nobody_for_longer_than_one_key():
    """Whatever comes, the stick stays in its range, and all ends with the last byte."""
    rng = np.random.default_rng(5)
    rest, keys = KeyBytes(), HeldKeys()
    for k in range(200):
        rest, found = find_keys(rest, rng.bytes(40), k * 10 * MS)
        for key in found:
            keys = keys.after(key, k * 10 * MS, 4)
        pad = keys.pad(k * 10 * MS)
        assert max(map(abs, pad.axes())) <= 1.0
        assert not (pad.enable and pad.reset)
    assert not keys.pad(199 * 10 * MS + FIRST_NS).enable


def held_until(presses, end_ns, key='w'):
    """Return the times, 1 ms apart, at which a key counts as held that comes at some times."""
    keys, waiting, found = HeldKeys(), list(presses), []
    for now_ns in range(0, end_ns, MS):
        while waiting and waiting[0] <= now_ns:
            keys = keys.after(key, waiting.pop(0), 1)
        if keys.pad(now_ns).enable:
            found.append(now_ns)
    return found


def test_one_press_counts_for_0_4_s():
    held = held_until([100 * MS], S)
    assert (held[0], held[-1]) == (100 * MS, 499 * MS)


@pytest.mark.parametrize('delay', [250 * MS, 399 * MS])
def test_a_key_that_repeats_is_held_without_a_gap_and_ends_0_15_s_after_its_last_repeat(delay):
    repeats = list(range(delay, 2 * S, 33 * MS))
    held = held_until([0, *repeats], 3 * S)
    assert held == list(range(0, repeats[-1] + 150 * MS, MS))


def test_a_terminal_that_is_slow_to_repeat_makes_a_gap_and_never_a_longer_move():
    repeats = list(range(600 * MS, S, 33 * MS))
    held = held_until([0, *repeats], 2 * S)
    assert 500 * MS not in held
    assert held[-1] < repeats[-1] + REPEAT_NS


@pytest.mark.parametrize(
    ('key', 'axes'),
    [
        ('w', (1, 0, 0)),
        ('a', (0, 1, 0)),
        ('q', (0, 0, 1)),
        ('left', (0, 0, 1)),
        ('o', (1, 0, -1)),
        ('.', (-1, 0, 1)),
        ('U', (1, 1, 0)),
    ],
)
def test_forward_left_and_turning_left_are_positive(key, axes):
    pad = HeldKeys().after(key, 0, 1).pad(0)
    assert (pad.x, pad.y, pad.yaw) == axes
    assert pad.enable


@pytest.mark.parametrize('pair', ['ws', 'ad', 'qe', 'jl', 'JL', ('up', 'down'), 'um', 'o.'])
def test_opposite_keys_are_opposite(pair):
    there, back = (np.array(MOTIONS[key]) for key in pair)
    if pair in ('um', 'o.'):  # a car that goes back on the same arc
        there, back = there * (1, 1, 1), back * (-1, 1, -1)
        assert tuple(there) == tuple(back)
    else:
        assert tuple(there) == tuple(-back)


def test_space_lets_go_at_once_and_an_emergency_stop_holds_whatever_is_typed_after():
    keys = HeldKeys().after('w', 0, 2)
    assert keys.after('space', MS, 2).pad(MS) == PadState()
    keys = keys.after('x', MS, 2)
    assert keys.pad(MS) == PadState(e_stop=True)
    assert keys.after('1', 2 * MS, 2).pad(3 * MS).e_stop
    assert keys.after('space', 2 * MS, 2).pad(3 * MS).e_stop


def test_reset_is_a_key_to_be_held_and_excludes_moving():
    keys = HeldKeys().after('w', 0, 2).after('R', MS, 2)
    assert keys.pad(MS) == PadState(reset=True)
    assert keys.after('w', 2 * MS, 2).pad(2 * MS).reset is False


def test_a_late_repeat_does_not_begin_the_reset_anew():
    keys = HeldKeys()
    for now_ns in range(0, 2 * S, 300 * MS):
        keys = keys.after('R', now_ns, 1)
        assert all(keys.pad(now_ns + k * MS).reset for k in range(300))


def test_speed_is_a_share_of_the_stick_between_a_tenth_and_all_of_it():
    keys = HeldKeys()
    for _ in range(20):
        keys = keys.after('-', 0, 1)
    assert keys.after('w', 0, 1).pad(0).x == pytest.approx(0.1)
    for _ in range(20):
        keys = keys.after('+', 0, 1)
    assert keys.after('s', 0, 1).pad(0).x == -1.0


def test_a_number_chooses_the_robot_on_the_screen_wherever_it_stands_in_the_team():
    places = places_of(('a1_2', 'a1_0'), ('a1_0', 'a1_1', 'a1_2'))
    pad = of_team(HeldKeys().after('1', 0, 2).pad(0), places)
    hands = read_joy('virtual_pad/test', pad.axes(), pad.buttons(3), JoystickParameters(), 3)
    assert hands.choice == 2
    assert HeldKeys().after('3', 0, 2).pad(0) == PadState()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--rate', '0'], ["'0'", '10 to 100 Hz']),
        (['--robots', 'a,a'], ["'a,a'", 'different']),
        (['--fast'], ['--fast', '--help']),
    ],
)
def test_a_bad_command_is_named_with_its_remedy(arguments, words):
    with pytest.raises(LayeredCbfError) as error:
        parse(arguments)
    assert all(word in str(error.value) for word in words)


def test_an_unknown_robot_is_named_with_those_there_are():
    with pytest.raises(LayeredCbfError, match=r"'spot'; there are a1_0, a1_1"):
        places_of(('spot',), ('a1_0', 'a1_1'))


def events(*entries):
    """Pack joystick events as the kernel documents them: u32 time, s16 value, u8, u8."""
    return b''.join(struct.pack('=IhBB', 0, value, kind, n) for value, kind, n in entries)


def test_the_stick_of_a_gamepad_is_read_as_joy_node_reads_it():
    """The kernel counts right and down, ROS left and up; joy_node divides by -32767."""
    data = events((-32767, 0x82, 1), (-32768, 0x02, 0), (16384, 0x02, 3), (1, 0x81, 4), (1, 1, 0))
    sticks = moved(Sticks(), data)
    assert sticks.axes == pytest.approx((1.0, 1.0, 0.0, -16384 / 32767))
    assert sticks.buttons == (1, 0, 0, 0, 1)
    assert moved(sticks, events((0, 0x01, 4))).buttons == (1, 0, 0, 0, 0)
    assert str(moved(sticks, events((0, 0x02, 0))).axes[0]) == '0.0'


def test_events_that_come_apart_and_kinds_of_others_change_nothing():
    data = events((-32767, 2, 0), (1, 1, 2), (7, 4, 1))
    whole, sticks = moved(Sticks(), data), Sticks()
    for k in range(len(data)):
        sticks = moved(sticks, data[k : k + 1])
    assert sticks == whole == Sticks((1.0,), (0, 0, 1))


# Codes of linux/input-event-codes.h
SOUTH, EAST, NORTH, WEST, TL, TR, TL2, TR2 = 0x130, 0x131, 0x133, 0x134, 0x136, 0x137, 0x138, 0x139
SELECT, START, MODE, THUMBL, THUMBR = 0x13A, 0x13B, 0x13C, 0x13D, 0x13E
XPAD = {SOUTH, EAST, NORTH, WEST, TL, TR, SELECT, START, MODE, THUMBL, THUMBR}
SONY = XPAD | {TL2, TR2}
DECK = SONY | {0x121, 0x122, 0x126, 0x220, 0x221, 0x222, 0x223}
STICKS_AND_TRIGGERS, DECK_AXES = [0, 1, 2, 3, 4, 5, 16, 17], [0, 1, 3, 4, 16, 17, 18, 19, 20, 21]
PADS = {
    'xbox': (XPAD, STICKS_AND_TRIGGERS),
    'logitech_f710': (XPAD, STICKS_AND_TRIGGERS),
    'ps4': (SONY, STICKS_AND_TRIGGERS),
    'ps5': (SONY, STICKS_AND_TRIGGERS),
    'steam_deck': (DECK, DECK_AXES),
}
PRESETS = sorted((ROOT / 'params' / 'joystick').glob('*.yaml'))


@pytest.mark.parametrize('pad', PADS)
def test_a_preset_means_the_same_places_of_the_hand_on_every_pad(pad):
    """The kernel numbers what a pad has in the order of its codes."""
    keys, axes = PADS[pad]
    p = from_file(JoystickParameters, ROOT / 'params' / 'joystick' / f'{pad}.yaml', 'coordinator')
    codes = sorted(keys)
    assert [axes[n] for n in (p.axis_linear_x, p.axis_linear_y, p.axis_angular_yaw)] == [1, 0, 3]
    assert [codes[n] for n in (p.enable_button, p.enable_turbo_button)] == [TL, TR]
    assert codes[p.e_stop_button] == EAST
    choices = (p.next_robot_button, p.all_button, p.formation_button)
    letters = {'ps4': (NORTH, WEST, SOUTH), 'ps5': (NORTH, WEST, SOUTH)}
    # xpad and hid-steam call X what the kernel calls north, and Y west
    assert tuple(codes[n] for n in choices) == letters.get(pad, (WEST, NORTH, SOUTH))


@pytest.mark.parametrize('path', PRESETS, ids=lambda path: path.stem)
def test_a_preset_is_complete_and_gives_no_button_two_meanings(path):
    p = from_file(JoystickParameters, path, 'coordinator')
    told = path.read_text()
    for field in dataclasses.fields(p):
        name = field.metadata.get('name') or field.name
        is_of_pad = name.startswith(('axis', 'scale', 'require')) or name.endswith('button')
        assert f' {name}: ' in told or not is_of_pad, name
    buttons = [getattr(p, f.name) for f in dataclasses.fields(p) if f.name.endswith('_button')]
    numbers = [n for n in buttons if not isinstance(n, bool) and n != OFF]
    assert len(set(numbers)) == len(numbers)


def motion(vx, vy=0.0, height=0.0):
    still = PlannedMotion.standing(0, np.zeros(2), 0.0)
    return dataclasses.replace(still, velocity=np.array([vx, vy]), height=height)


TEAM = ('a1_0', 'a1_1')
NAMES = ['a1_0/x', 'a1_0/y', 'a1_1/x', 'a1_1/y']


def example():
    """Return what is heard of two robots and an obstacle."""
    heard = Heard(TEAM, 12 * S, 100 * S, {'a1_0': (0.0, 0.0), 'a1_1': (3.0, 4.0)})
    heard = with_tracks(heard, {'cart': (1.0, -2.0)})
    heard = with_desired(heard, NAMES, np.array([0.3, 0.4, 0.0, 0.0]), np.array([0.0, 0, 1, 1]))
    return dataclasses.replace(
        heard,
        speeds={'a1_0': 0.48},
        plans={'a1_0': motion(0.3, -0.4), 'a1_1': motion(0.0)},
        interventions={'a1_0': 0.5, 'a1_1': 0.0},
        barriers={'a1_0~cart': 0.7, 'a1_0~a1_1': 2.5, 'a1_1~cart': 1.5},
        commands={'a1_0': VelocityCommand(0.3, 0.0), 'a1_1': None},
    )


def test_a_row_tells_speeds_the_nearest_neighbour_and_the_smallest_barrier():
    row = row_of(example(), 'a1_0')
    assert (row.measured, row.planned, row.desired) == (0.48, pytest.approx(0.5), 0.5)
    assert (row.neighbour, row.distance) == ('cart', pytest.approx(5**0.5))
    assert (row.h, row.intervention, row.state) == (0.7, 0.5, 'steered')
    other = row_of(example(), 'a1_1')
    assert (other.neighbour, other.distance, other.h) == ('a1_0', 5.0, 1.5)
    assert (other.measured, other.state) == (None, 'held')


def test_a_robot_that_goes_down_sits_and_a_track_that_is_gone_is_no_neighbour():
    heard = dataclasses.replace(example(), plans={'a1_0': motion(0.0, height=-0.1)})
    assert row_of(heard, 'a1_0').state == 'sitting'
    assert row_of(with_tracks(heard, {}), 'a1_0').neighbour == 'a1_1'


def test_the_emergency_stop_is_shown_from_diagnostics_only_until_commands_tell_it():
    early = with_words(Heard(TEAM), {'e_stop': 'latched'})
    assert early.is_stopped
    assert not with_words(example(), {'e_stop': 'latched'}).is_stopped


def shown(view, columns=80, rows=24):
    """Return a picture as text, without its styles."""
    lines = lines_of(view, columns, rows)
    for style in ('\x1b[1;7m', '\x1b[1m', '\x1b[2m'):
        lines = [line.removeprefix(style) for line in lines]
    return lines


def test_a_small_terminal_shows_eight_robots_and_how_to_stop_them():
    names = tuple(f'quadruped_{k}' for k in range(8))
    view = view_of(Heard(names, heard_ns=0), names, '7', 0)
    lines = shown(view)
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    text = '\n'.join(lines)
    assert all(f'{k + 1} {name}' in text for k, name in enumerate(names))
    assert 'EMERGENCY STOP' in text
    assert shown(view, 20, 3) == [line[:20] for line in lines[:3]]


def test_the_screen_shows_who_steers_and_each_figure():
    view = view_of(example(), TEAM, '7', 100 * S)
    lines = shown(dataclasses.replace(view, operator='joy/js0'))
    assert lines[0].startswith('joy/js0 steers')
    row = next(line for line in lines if line.startswith('1 a1_0'))
    figures = row.split()
    assert figures[:8] == ['1', 'a1_0', '0.48', '0.50', '0.50', '2.24', 'cart', '0.70']
    assert figures[8:] == ['##......', '0.50', 'steered']


def test_what_is_wrong_stands_in_the_first_line():
    assert 'nobody is there' in shown(view_of(Heard(), (), '7', 0))[0]
    assert 'ROS_DOMAIN_ID 7' in shown(view_of(Heard(), (), '7', 0))[0]
    assert 'for 5 s' in shown(view_of(example(), TEAM, '7', 105 * S))[0]
    stopped = dataclasses.replace(view_of(example(), TEAM, '7', 100 * S), is_stopped=True)
    assert 'EMERGENCY STOP' in shown(stopped)[0]


def test_a_name_can_not_play_tricks_on_the_terminal():
    view = ScreenView(0.0, '0', operator='joy/\x1b[2Jx\n', note='\x07')
    assert all(c >= ' ' for line in shown(view) for c in line)


def test_the_bar_is_empty_only_if_the_filter_does_nothing():
    assert [bar(v).count('#') for v in (None, 0.0, 0.02, 1.0, 2.0, 99.0)] == [0, 0, 1, 4, 8, 8]
