"""teleop as a person has it: a real process on a real terminal, and who listens to it."""

from __future__ import annotations

import fcntl
import os
import signal
import struct
import termios
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from live_replay import Listener, LiveReplay
from live_run import LiveRun
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Joy
from std_msgs.msg import String

from layered_cbf_ros.nodes.transport import latched
from layered_cbf_ros.operation import virtual_pad as pad
from layered_cbf_ros.scenario_file import load_scenario, to_json

pytestmark = pytest.mark.system

CTRL_C, CTRL_Z, RIGHT = b'\x03', b'\x1a', b'\x1b[C'
LEAVE = b'\x1b[?1049l'  # back to what the terminal showed before


class LiveTeleop(LiveReplay):
    """A running teleop, on a terminal or without one."""

    program = 'from layered_cbf_ros.nodes.teleop import main; main()'

    def hang_up(self):
        """Take its terminal away, as when a window is closed or a connection breaks."""
        os.close(self._outer)
        self._outer = -1
        os.close(self._inner)

    def resize(self, columns, rows):
        size = struct.pack('HHHH', rows, columns, 0, 0)
        fcntl.ioctl(self._inner, termios.TIOCSWINSZ, size)

    def type_ahead(self, line):
        """Type a line, and see that it waits in the terminal."""
        self.press(line)
        while fcntl.ioctl(self._inner, termios.FIONREAD, bytes(4)) == bytes(4):
            time.sleep(0.01)

    def picture(self):
        """Return the last whole picture of its screen, as lines."""
        self.shows(b'')
        pictures = self.screen.split(b'\x1b[H')
        return pictures[-2].decode().split('\r\n') if len(pictures) > 2 else []


@pytest.fixture
def listener():
    listener = Listener()
    listener.listen('/joy', Joy)
    yield listener
    listener.close()


@pytest.fixture
def teleop():
    started = []

    def start(*arguments, terminal=True):
        started.append(LiveTeleop(*arguments, terminal=terminal))
        return started[-1]

    yield start
    for one in started:
        one.close()


def joys(listener):
    """Return the Joy messages that were heard."""
    return [deserialize_message(data, Joy) for topic, data in listener.heard if topic == '/joy']


def time_of(joy):
    return joy.header.stamp.sec + 1e-9 * joy.header.stamp.nanosec


def is_enabled(joy):
    return joy.buttons[pad.ENABLE] == 1


def until_heard(listener, one):
    """Wait until a terminal's keys are heard: from then on nothing is lost."""

    def is_heard():
        one.press(b'f')
        one.shows(b'')
        return any(joy.buttons[pad.FORMATION] for joy in joys(listener))

    listener.until(is_heard)


def hold(listener, one, key, condition):
    """Press a key again and again, as a terminal repeats it, until something holds."""

    def is_so():
        one.press(key)
        one.shows(b'')
        return condition()

    listener.until(is_so)


def test_a_held_key_moves_forward_and_what_is_let_go_is_released_and_then_silent(listener, teleop):
    one = teleop()
    until_heard(listener, one)
    hold(listener, one, b'w', lambda: sum(map(is_enabled, joys(listener))) > 10)
    listener.until(lambda: not is_enabled(joys(listener)[-1]))
    heard = joys(listener)
    (name,) = {joy.header.frame_id for joy in heard}
    assert name == f'{pad.FRAME}/teleop/{one.process.pid}'
    assert {tuple(joy.axes) for joy in heard if is_enabled(joy)} == {(1.0, 0.0, 0.0)}
    assert {tuple(joy.axes) for joy in heard if not is_enabled(joy)} == {(0.0, 0.0, 0.0)}
    end = time.monotonic() + 0.5
    listener.until(lambda: time.monotonic() > end)
    is_held = [any(joy.buttons) for joy in joys(listener)]
    assert 1 <= is_held[::-1].index(True) <= 5
    hold(listener, one, RIGHT, lambda: joys(listener)[-1].axes[pad.YAW] == -1.0)


def test_an_emergency_stop_is_sent_by_every_message_of_a_second_without_an_age(listener, teleop):
    """It has no stamp: however late it comes, it counts."""
    one = teleop()
    until_heard(listener, one)
    one.press(b'x')
    listener.until(lambda: sum(joy.buttons[pad.E_STOP] for joy in joys(listener)) >= 10)
    stops = [joy for joy in joys(listener) if joy.buttons[pad.E_STOP]]
    assert not any(is_enabled(joy) for joy in stops)
    assert {joy.header.stamp.sec for joy in stops} == {0}


def test_robots_are_those_of_the_run_and_a_wrong_name_is_told_with_them(listener, teleop):
    scenario = to_json(load_scenario('four_agents'))
    publisher = listener.node.create_publisher(String, '/scenario', latched())
    publisher.publish(String(data=scenario))
    one = teleop('--robots', 'a1_3,a1_1')
    listener.until(lambda: one.shows(b'2 a1_1'))
    assert b'a1_0' not in one.screen
    hold(
        listener, one, b'1', lambda: any(joy.buttons[pad.FIRST_ROBOT + 3] for joy in joys(listener))
    )
    wrong = teleop('--robots', 'spot')
    listener.until(lambda: wrong.process.poll() is not None)
    code, _, (line,) = wrong.end()
    assert code == 2
    assert "'spot'" in line
    assert 'a1_0, a1_1, a1_2, a1_3' in line
    assert wrong.terminal_modes() == wrong.before


@pytest.mark.parametrize('way', ['ctrl_c', 'SIGTERM', 'hang_up'])
def test_whoever_ends_it_the_robots_are_let_go(listener, teleop, way):
    one = teleop()
    until_heard(listener, one)
    assert one.terminal_modes() != one.before
    hold(listener, one, b'w', lambda: is_enabled(joys(listener)[-1]))
    if way == 'hang_up':
        one.hang_up()
    elif way == 'ctrl_c':
        one.press(CTRL_C)
    else:
        one.interrupt(signal.SIGTERM)
    listener.until_ended(one)
    if way != 'hang_up':
        assert one.terminal_modes() == one.before
        assert one.shows(LEAVE)
    assert one.end()[0] == 0
    assert not is_enabled(joys(listener)[-1])


def test_after_a_kill_it_is_silent_and_its_terminal_is_usable(listener, teleop):
    one = teleop()
    until_heard(listener, one)
    hold(listener, one, b'w', lambda: is_enabled(joys(listener)[-1]))
    one.interrupt(signal.SIGKILL)
    listener.until(lambda: one.terminal_modes() == one.before and one.shows(LEAVE))
    listener.until_ended(one)
    count = len(joys(listener))
    end = time.monotonic() + 0.3
    listener.until(lambda: time.monotonic() > end)
    assert len(joys(listener)) == count


def test_set_aside_it_lets_go_and_gives_the_terminal_back_until_it_goes_on(listener, teleop):
    one = teleop()
    until_heard(listener, one)
    hold(listener, one, b'w', lambda: is_enabled(joys(listener)[-1]))
    one.press(CTRL_Z)
    status = Path(f'/proc/{one.process.pid}/stat')
    listener.until(lambda: status.read_text().rpartition(')')[2].split()[0] == 'T')
    assert one.terminal_modes() == one.before
    one.type_ahead(b'wwwww\n')  # for whoever reads then, not for robots
    continued_s = time.time()
    one.interrupt(signal.SIGCONT)
    listener.until(lambda: one.terminal_modes() != one.before)
    one.resize(40, 5)
    listener.until(lambda: len(one.picture()) == 5)
    end = time.monotonic() + 0.5
    listener.until(lambda: time.monotonic() > end)
    assert not is_enabled(joys(listener)[-1])
    assert not any(is_enabled(joy) and time_of(joy) > continued_s for joy in joys(listener))


def test_without_a_terminal_there_is_one_line_and_exit_code_two(teleop):
    code, output, (line,) = teleop(terminal=False).end()
    assert (code, output) == (2, '')
    assert 'terminal' in line
    assert '--gamepad' in line


def event(value, kind, number):
    return struct.pack('=IhBB', 0, value, kind, number)


def test_a_gamepad_is_heard_and_silent_once_it_is_unplugged_until_it_comes_back(
    tmp_path, listener, teleop
):
    """A pipe stands for the device: both are read in the same way."""
    device = tmp_path / 'js7'
    os.mkfifo(device)
    plug = os.open(device, os.O_RDWR)
    one = teleop('--gamepad', device, terminal=False)
    os.write(plug, event(-32767, 2, 1) + event(1, 1, 4))
    listener.until(lambda: len(joys(listener)) > 3)
    last = joys(listener)[-1]
    assert last.header.frame_id == 'joy/js7'
    assert (list(last.axes), list(last.buttons)) == ([0.0, 1.0], [0, 0, 0, 0, 1])
    count = len(joys(listener))
    listener.until(lambda: len(joys(listener)) > count + 3)  # it repeats what is held
    device.unlink()
    os.close(plug)
    while (line := one.process.stdout.readline()) and b'unplugged' not in line:
        pass
    assert str(device).encode() in line
    count, end = -1, 0.0
    while count != len(joys(listener)):
        count, end = len(joys(listener)), time.monotonic() + 0.3
        listener.until(lambda end=end: time.monotonic() > end)
    os.mkfifo(device)
    plug = os.open(device, os.O_RDWR)
    os.write(plug, event(-32767, 2, 0))
    listener.until(lambda: list(joys(listener)[-1].axes) == [1.0])
    os.close(plug)
    one.interrupt()
    listener.until_ended(one)
    assert one.process.returncode == 0


def test_a_person_at_a_keyboard_drives_a_robot_and_it_stops_when_the_key_is_let_go(
    tmp_path, listener, teleop
):
    """The whole way: key, Joy, coordinator, plan, base, and back onto the screen."""
    scenario = tmp_path / 'steered.yaml'
    scenario.write_text(
        'description: One base.\nduration: 3000.0\nplant: bases\n'
        'robots:\n  - {name: base_0, position: [0.0, 0.0]}\n'
    )
    run = LiveRun(scenario, tmp_path / 'run', '--no-record')
    listener.listen('/base_0/odom', Odometry)
    one = teleop()

    def odom():
        data = next(d for topic, d in reversed(listener.heard) if topic == '/base_0/odom')
        return deserialize_message(data, Odometry)

    try:
        listener.until(lambda: any(topic == '/base_0/odom' for topic, _ in listener.heard))
        hold(listener, one, b'1', lambda: one.shows(b'time of the run'))
        hold(listener, one, b'w', lambda: odom().pose.pose.position.x > 0.3)
        assert odom().twist.twist.linear.x > 0.1
        listener.until(lambda: odom().twist.twist.linear.x < 0.01)
        listener.until(lambda: any('steered' in line for line in one.picture()))
        hold(listener, one, b'x', lambda: 'EMERGENCY' in one.picture()[0])
    finally:
        run.process.send_signal(signal.SIGINT)
        run.end()
    assert abs(odom().pose.pose.position.y) < 0.05
