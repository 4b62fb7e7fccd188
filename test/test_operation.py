"""An operator's desk: nobody moves without a hand on the pad, and anybody can stop all."""

import math
import random

import pytest

from layered_cbf_ros.errors import MessageError, ParameterError
from layered_cbf_ros.interfaces import NS_PER_S, VelocityCommand
from layered_cbf_ros.operation.desk import Asked, Desk, Now, asked, heard, released, reset, stopped
from layered_cbf_ros.operation.joystick import Choice, Hands, read_joy
from layered_cbf_ros.operation.orders import STILL, no_orders, ordered
from layered_cbf_ros.operation.parameters import JoystickParameters
from layered_cbf_ros.operation.told import read_told, told, told_names
from layered_cbf_ros.operation.virtual_pad import PadState
from layered_cbf_ros.parameters import from_mapping

P = JoystickParameters()
TIMEOUT_NS = round(P.joy_timeout * NS_PER_S)
PAD, OTHER = 'joy', 'virtual_pad/viewer'
ROBOTS = 3
MS = 1_000_000
FORWARD = Hands(x=0.3, enable=True)


def at(milliseconds):
    """Return a moment at which both clocks agree."""
    return Now(round(milliseconds * MS), round(milliseconds * MS))


def told_by(desk, hands, milliseconds, name=PAD):
    return heard(desk, name, hands, at(milliseconds), ROBOTS, TIMEOUT_NS)


def xbox(axes=None, held=()):
    """Return axes and buttons of a pad with 8 axes and 11 buttons."""
    values = [0.0] * 8
    for number, value in (axes or {}).items():
        values[number] = value
    return values, [int(number in held) for number in range(11)]


def wishes(desk, milliseconds=0.0):
    """Return the commands once every velocity has had the time to grow."""
    now = at(milliseconds)
    before = no_orders(now.run_ns - 10 * NS_PER_S, ROBOTS)
    return ordered(before, released(desk, now, TIMEOUT_NS), now, P).commands


def test_the_stick_is_scaled_and_has_a_dead_zone_that_begins_at_zero():
    def forward(share):
        return read_joy(PAD, *xbox({1: share}, {4}), P, ROBOTS).x

    assert forward(0.1) == forward(-0.1) == forward(0.0) == 0.0
    assert 0.0 < forward(0.11) < 0.01
    assert forward(1.0) == pytest.approx(0.35)
    assert forward(-1.0) == pytest.approx(-0.35)
    assert forward(7.0) == forward(1.0)
    assert read_joy(PAD, *xbox({1: 1.0}, {4, 5}), P, ROBOTS).x == pytest.approx(0.5)


def test_left_is_left_and_turning_left_is_positive():
    """Axes of joy_node count to the left; so do y and yaw of REP-103."""
    hands = read_joy(PAD, *xbox({0: 1.0, 3: 1.0}, {4}), P, ROBOTS)
    assert hands.y > 0.0
    assert hands.yaw_rate > 0.0


def test_without_the_enable_button_the_stick_does_not_count():
    hands = read_joy(PAD, *xbox({0: 1.0, 1: 1.0, 3: 1.0}, {5}), P, ROBOTS)
    assert (hands.x, hands.y, hands.yaw_rate) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('axes', 'buttons', 'words'),
    [
        ([0.0, 0.0], [0] * 11, r'2 axes, but axis_angular\.yaw is number 3'),
        ([0.0] * 8, [0, 0], '2 buttons, but enable_turbo_button is number 5'),
        ([0.0, math.nan, 0.0, 0.0], [0] * 11, r"from 'joy': axes\[1\] is nan"),
        ([math.inf, 0.0, 0.0, 0.0], [0] * 11, r'axes\[0\] is inf'),
    ],
)
def test_a_bad_joy_message_is_named(axes, buttons, words):
    with pytest.raises(MessageError, match=words):
        read_joy(PAD, axes, buttons, P, ROBOTS)


def test_a_virtual_pad_is_read_by_its_own_layout_whatever_the_parameters_are():
    other = from_mapping(JoystickParameters, {'axis_linear.x': 7, 'enable_button': 9})
    pad = PadState(x=1.0, y=-1.0, yaw=0.5, enable=True, robot=2)
    hands = read_joy(OTHER, pad.axes(), pad.buttons(ROBOTS), other, ROBOTS)
    expected = (P.scale_linear_x, -P.scale_linear_y, 0.5 * P.scale_angular_yaw)
    assert (hands.x, hands.y, hands.yaw_rate) == pytest.approx(expected)
    assert hands.choice == 2
    with pytest.raises(MessageError, match='selects robot 5 of 3'):
        read_joy(OTHER, [0.0] * 3, PadState(robot=4).buttons(5), P, ROBOTS)


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'require_enable_button': False}, 'require_enable_button is False'),
        ({'enable_button': -1}, r'enable_button is -1; keep it in \[0, 63\]'),
        ({'e_stop_button': 4}, 'enable_button and e_stop_button are both 4'),
    ],
)
def test_parameters_that_would_take_the_hand_off_the_pad_are_refused(values, words):
    with pytest.raises(ParameterError, match=words):
        from_mapping(JoystickParameters, values)


def test_robots_keep_their_goals_until_somebody_holds_the_enable_button():
    desk, _ = told_by(Desk(), Hands(), 0)
    assert wishes(desk) == (None, None, None)
    desk, _ = told_by(desk, FORWARD, 20)
    assert wishes(desk, 20) == (VelocityCommand(0.3, 0.0), None, None)


def test_release_and_silence_stop_the_robot_and_do_not_give_it_back_to_its_goal():
    desk, _ = told_by(Desk(), FORWARD, 0)
    let_go, _ = told_by(desk, Hands(), 20)
    assert wishes(let_go, 20) == (STILL, None, None)
    assert wishes(desk, 149)[0] == VelocityCommand(0.3, 0.0)
    assert wishes(desk, 151) == (STILL, None, None)


def test_a_command_grows_by_its_rate_limit_and_falls_at_once():
    """dv/dt <= linear_rate_limit; zero comes within one tick of the release."""
    desk, _ = told_by(Desk(), Hands(x=0.3, yaw_rate=1.0, enable=True), 0)
    orders, speeds = no_orders(0, 1), []
    for tick in range(1, 120):
        orders = ordered(orders, desk, at(tick), P)
        speeds.append(orders.commands[0].x)
    growth = [b - a for a, b in zip([0.0, *speeds], speeds, strict=False)]
    assert max(growth) <= P.linear_rate_limit * 1e-3 + 1e-12
    assert speeds[99] == pytest.approx(P.linear_rate_limit * 0.1)
    let_go, _ = told_by(desk, Hands(), 120)
    assert ordered(orders, let_go, at(120), P).commands == (STILL,)


def test_reversing_goes_through_zero_without_a_pause():
    desk, _ = told_by(Desk(), Hands(x=-0.3, enable=True), 0)
    before = ordered(no_orders(-NS_PER_S, 1), told_by(Desk(), FORWARD, 0)[0], at(0), P)
    after = ordered(before, desk, at(1), P).commands[0].x
    assert after == pytest.approx(-P.linear_rate_limit * 1e-3)


def test_buttons_choose_one_all_a_formation_or_nobody():
    desk, _ = told_by(Desk(), Hands(x=0.3, enable=True, choice=Choice.NEXT), 0)
    assert desk.steered == (0,)
    desk, _ = told_by(desk, FORWARD, 20)
    desk, _ = told_by(desk, Hands(x=0.3, enable=True, choice=Choice.NEXT), 40)
    desk, _ = told_by(desk, Hands(x=0.3, enable=True, choice=Choice.NEXT), 60)
    assert desk.steered == (1,), 'a button that stays down counts once'
    desk, _ = told_by(desk, Hands(x=0.3, enable=True, choice=Choice.ALL), 80)
    assert wishes(desk, 80) == (VelocityCommand(0.3, 0.0),) * ROBOTS
    desk, _ = told_by(desk, Hands(x=0.3, enable=True, choice=Choice.FORMATION), 100)
    assert wishes(desk, 100) == (VelocityCommand(0.3, 0.0, leader=0),) * ROBOTS
    desk, _ = told_by(desk, Hands(choice=Choice.NOBODY), 120)
    assert wishes(desk, 120) == (None,) * ROBOTS


def test_a_second_operator_is_refused_until_the_first_lets_go():
    desk, _ = told_by(Desk(), FORWARD, 0)
    backward = Hands(x=-0.3, enable=True, choice=2)
    desk, refusal = told_by(desk, backward, 20, OTHER)
    assert refusal == f"joy from '{OTHER}' is refused: 'joy' steers"
    assert wishes(desk, 20) == (VelocityCommand(0.3, 0.0), None, None)
    desk, _ = told_by(desk, Hands(), 40)
    desk, refusal = told_by(desk, backward, 60, OTHER)
    assert refusal == ''
    assert desk.owner == OTHER
    assert wishes(desk, 60)[0] == VelocityCommand(-0.3, 0.0)


def test_a_silent_owner_loses_the_control_to_the_next_one():
    desk, _ = told_by(Desk(), FORWARD, 0)
    desk, refusal = told_by(desk, FORWARD, 200, OTHER)
    assert (desk.owner, refusal) == (OTHER, '')


def test_an_idle_pad_beside_the_one_that_steers_changes_nothing():
    """joy_node repeats its last message at 20 Hz, pressed or not."""
    desk, _ = told_by(Desk(), FORWARD, 0)
    desk, refusal = told_by(desk, Hands(), 10, OTHER)
    assert (desk.owner, refusal) == (PAD, '')
    assert wishes(desk, 10)[0] == VelocityCommand(0.3, 0.0)


def test_anybody_can_stop_all_and_the_stop_is_latched():
    desk, _ = told_by(Desk(), FORWARD, 0)
    desk, _ = told_by(desk, Hands(e_stop=True), 20, OTHER)
    assert desk.stopped
    desk, _ = told_by(desk, FORWARD, 40)
    desk, _ = told_by(desk, Hands(), 60, OTHER)
    assert desk.stopped
    assert wishes(desk, 60) == (STILL, None, None)


def test_only_a_reset_held_for_a_second_ends_the_stop():
    desk = stopped(Desk())
    for time in range(0, 980, 20):
        desk, _ = told_by(desk, Hands(reset=True), time)
    assert desk.stopped
    desk, _ = told_by(desk, Hands(), 980)
    for time in range(1000, 2000, 20):
        desk, _ = told_by(desk, Hands(reset=True), time)
        assert desk.stopped
    desk, _ = told_by(desk, Hands(reset=True), 2000)
    assert not desk.stopped
    assert desk.owner == ''


def test_a_reset_interrupted_by_silence_begins_anew():
    desk = stopped(Desk())
    for time in (0, 500, 1000, 1500):
        desk, _ = told_by(desk, Hands(reset=True), time)
    assert desk.stopped


def test_nobody_resets_while_another_one_presses_the_stop():
    desk = stopped(Desk())
    for time in range(0, 1500, 20):
        desk, _ = told_by(desk, Hands(reset=True), time)
        desk, _ = told_by(desk, Hands(e_stop=True), time, OTHER)
    assert desk.stopped


def test_a_planner_steers_one_robot_within_the_limits_and_its_silence_stops_it():
    desk = asked(Desk(), 1, Asked(0.0, 4.0, -2.0, 0), (0.5, 1.0))
    assert wishes(desk) == (None, VelocityCommand(0.0, 0.5, -1.0), None)
    assert desk.clamped == 1
    assert wishes(desk, 151) == (None, STILL, None)
    desk = asked(desk, 1, Asked(0.1, 0.0, 0.0, 0), (0.5, 1.0))
    assert desk.clamped == 1


def test_an_operator_goes_before_a_planner():
    desk = asked(Desk(), 0, Asked(-0.2, 0.0, 0.0, 0), (0.5, 1.0))
    desk, _ = told_by(desk, FORWARD, 0)
    assert wishes(desk)[0] == VelocityCommand(0.3, 0.0)
    desk, _ = told_by(desk, Hands(choice=Choice.NOBODY), 20)
    assert wishes(desk, 20)[0] == VelocityCommand(-0.2, 0.0)


def test_a_stop_holds_planners_too():
    desk = stopped(asked(Desk(), 0, Asked(-0.2, 0.0, 0.0, 0), (0.5, 1.0)))
    assert wishes(desk)[0] == STILL
    assert wishes(reset(desk))[0] == VelocityCommand(-0.2, 0.0)


@pytest.mark.parametrize('seed', range(20))
def test_no_history_moves_a_robot_without_a_fresh_hand_on_a_pad(seed):
    """An oracle of its own: somebody must have said `enable` within the last 0.15 s."""
    rng = random.Random(seed)
    desk, orders, last_enabled = Desk(), no_orders(0, ROBOTS), {}
    time = 0.0
    moved = 0
    for _ in range(400):
        time += rng.choice((1.0, 20.0, 60.0, 200.0))
        name = rng.choice((PAD, OTHER, 'third'))
        if rng.random() < 0.8:
            choice = rng.choice((None, None, *Choice, 0, 1, 2))
            enable, e_stop = rng.random() < 0.7, rng.random() < 0.02
            stick = rng.uniform(-1.0, 1.0) if enable else 0.0
            hands = Hands(
                stick, 0.0, 0.0, enable, e_stop, not enable and rng.random() < 0.5, choice
            )
            desk, _ = told_by(desk, hands, time, name)
            last_enabled[name] = time if enable else -math.inf
            if rng.random() < 0.05:
                desk = reset(desk)
        desk = released(desk, at(time), TIMEOUT_NS)
        orders = ordered(orders, desk, at(time), P)
        fresh = any(time - since <= 150.0 for since in last_enabled.values())
        for command in orders.commands:
            if command is not None and command != STILL:
                moved += 1
                assert fresh
                assert not desk.stopped
                assert abs(command.x) <= 1.0
    assert moved > 20


def test_what_was_asked_can_be_read_back_to_the_bit():
    robots = ['a1_0', 'b', 'c_2']
    commands = (VelocityCommand(0.1, -1 / 3, 2e-17), None, VelocityCommand(-0.0, 1e300, 0.5, 2))
    orders = no_orders(5, 3)
    orders = type(orders)(5, commands, True)
    _, velocities, _, effort = told(orders)
    names = told_names(robots)
    assert read_told(names, velocities, effort, robots) == (commands, True)
    assert read_told(names, velocities, effort, ['b', 'nobody']) == ((None, None), True)
