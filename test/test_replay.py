"""Replay as a user starts it: every byte, in order, to real subscribers."""

from __future__ import annotations

import signal
import struct

import pytest

pytest.importorskip('rclpy')

import yaml
from live_replay import Listener, LiveReplay
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSLivelinessPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
)
from rosbags.rosbag2 import StoragePlugin
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, String
from test_bag_reading import write_foreign
from test_bags import CHANNEL, HEAD, TAIL, record, string_cdr, string_message, text

from layered_cbf_ros.bags.storage.metadata import qos_yaml
from layered_cbf_ros.bags.storage.writer import BagWriter

pytestmark = pytest.mark.system

MS, S = 1_000_000, 1_000_000_000
STRING = 'std_msgs/msg/String'
SPACE, RIGHT, CTRL_C = b' ', b'\x1b[C', b'\x03'
LATCHED = QoSProfile(
    depth=10,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)


@pytest.fixture
def listener():
    listener = Listener()
    yield listener
    listener.close()


@pytest.fixture
def replay():
    started = []

    def start(*arguments, **options):
        """Start a replay; its delay is for a slow machine, on which readers come late."""
        started.append(LiveReplay(*arguments, '-d', '2', **options))
        return started[-1]

    yield start
    for one in started:
        one.close()


def write(folder, entries, qos=None):
    """Write strings: (topic, log time, text); return the folder."""
    topics = {}
    with BagWriter(folder) as bag:
        for topic, log_ns, word in entries:
            if topic not in topics:
                topics[topic] = bag.add_topic(topic, STRING, (qos or {}).get(topic))
            bag.write(topics[topic], string_cdr(word), log_ns, log_ns)
    return folder


def numbers(count, topic='/said', step_ns=MS):
    return [(topic, S + k * step_ns, str(k)) for k in range(count)]


def said(listener, topic='/said'):
    found = []
    for name, data in listener.heard:
        (size,) = struct.unpack_from('<I', data, 4)
        if name == topic:
            found.append(data[8 : 7 + size].decode())
    return found


def test_all_bytes_come_in_the_order_of_log_times_across_topics(tmp_path, listener, replay):
    """Shuffled in the file, some at one time: those keep the order of the file.

    The words fill whole words of memory: the middleware pads others with zeros.
    """
    topics = ('/a', '/b', '/c')
    entries = [(topics[k * 7 % 3], S + (k * 37 % 100) // 2 * MS, f'{k:07}') for k in range(300)]
    bag = write(tmp_path / 'bag', entries)
    for topic in topics:
        listener.listen(topic, String)
    one = replay(bag)
    listener.until_ended(one)
    code, output, errors = one.end()
    assert (code, errors) == (0, []), output
    expected = sorted(entries, key=lambda entry: entry[1])
    assert listener.heard == [(topic, string_cdr(word)) for topic, _, word in expected]
    assert 'sent 300 messages' in output
    assert 'timing error: mean' in output


def test_sqlite3_bags_of_others_are_played(tmp_path, listener, replay):
    write_foreign(tmp_path / 'bag', StoragePlugin.SQLITE3, None)
    listener.listen('/said', String, LATCHED)
    one = replay(tmp_path / 'bag')
    listener.until_ended(one)
    assert one.end()[0] == 0
    assert said(listener) == ['one', 'two']


def test_chosen_topics_are_sent_under_new_names_and_no_others(tmp_path, listener, replay):
    bag = write(tmp_path / 'bag', [*numbers(3, '/a'), *numbers(3, '/b'), *numbers(3, '/c')])
    for topic in ('/a', '/b', '/c', '/old/a'):
        listener.listen(topic, String)
    one = replay(bag, '--exclude-topics', '/b', '-m', '/a:=/old/a')
    listener.until_ended(one)
    code, _, errors = one.end()
    assert (code, errors) == (0, [])
    assert {topic for topic, _ in listener.heard} == {'/old/a', '/c'}
    assert said(listener, '/old/a') == ['0', '1', '2']


def test_offset_and_duration_cut_the_bag_at_both_ends(tmp_path, listener, replay):
    bag = write(tmp_path / 'bag', numbers(100))
    listener.listen('/said', String)
    one = replay(bag, '--start-offset', '0.02', '--playback-duration', '0.03')
    listener.until_ended(one)
    assert one.end()[0] == 0
    assert said(listener) == [str(k) for k in range(20, 51)]


def test_a_loop_begins_again_until_it_is_interrupted(tmp_path, listener, replay):
    bag = write(tmp_path / 'bag', numbers(3))
    listener.listen('/said', String)
    one = replay(bag, '--loop')
    listener.until(lambda: len(listener.heard) >= 10)
    one.interrupt()
    listener.until_ended(one)
    assert one.end()[0] == 130
    heard = said(listener)
    assert heard == [str(k % 3) for k in range(len(heard))]


def test_publishers_have_the_recorded_quality_of_service(tmp_path, listener, replay):
    (entry,) = yaml.safe_load(qos_yaml('best_effort', 'volatile'))
    entry |= {
        'deadline': {'sec': 0, 'nsec': 500_000_000},
        'lifespan': {'sec': 3, 'nsec': 0},
        'liveliness': 'manual_by_topic',
        'liveliness_lease_duration': {'sec': 7, 'nsec': 1},
    }
    latched = qos_yaml('reliable', 'transient_local', 1)
    qos = {'/fast': yaml.safe_dump([entry]), '/latched': latched}
    bag = write(
        tmp_path / 'bag',
        [('/latched', S, 'kept'), ('/fast', S, 'x'), ('/said', 100 * S, 'late')],
        qos,
    )
    one = replay(bag)
    listener.until(lambda: listener.node.count_publishers('/fast') == 1)
    (info,) = listener.node.get_publishers_info_by_topic('/fast')
    found = info.qos_profile
    assert found.reliability == QoSReliabilityPolicy.BEST_EFFORT
    assert found.durability == QoSDurabilityPolicy.VOLATILE
    assert found.liveliness == QoSLivelinessPolicy.MANUAL_BY_TOPIC
    assert found.deadline.nanoseconds == 500_000_000
    assert found.lifespan.nanoseconds == 3 * S
    assert found.liveliness_lease_duration.nanoseconds == 7 * S + 1
    # a late joiner gets what is latched
    listener.listen('/latched', String, LATCHED)
    listener.until(lambda: said(listener, '/latched') == ['kept'])
    one.interrupt(signal.SIGTERM)
    assert one.end()[0] == 130


def test_the_clock_goes_in_bag_time_and_never_back(tmp_path, listener, replay):
    bag = write(tmp_path / 'bag', numbers(11, step_ns=100 * MS))
    listener.listen('/clock', Clock)
    one = replay(bag, '--clock', '100', '-r', '2')
    listener.until_ended(one)
    assert one.end()[0] == 0
    times = [sec * S + ns for sec, ns in (struct.unpack('<iI', d[4:]) for _, d in listener.heard)]
    assert times == sorted(times)
    assert times[0] >= S
    assert S + 500 * MS < times[-1] <= 2 * S + 100 * MS
    assert len([time for time in times if time < S + MS]) > 5  # it stands still in the delay


def test_space_pauses_and_right_arrow_sends_one_message(tmp_path, listener, replay):
    bag = write(tmp_path / 'bag', numbers(50, step_ns=0))
    listener.listen('/said', String)
    one = replay(bag, '--start-paused', terminal=True)
    listener.until(lambda: one.shows(b'paused'))
    for count in range(1, 4):
        one.press(RIGHT)
        listener.until(lambda count=count: len(listener.heard) >= count)
        assert said(listener) == [str(k) for k in range(count)]
    one.press(SPACE)
    listener.until_ended(one)
    assert one.shows(b'sent 50 messages')
    assert one.terminal_modes() == one.before
    assert one.end()[0] == 0
    assert said(listener) == [str(k) for k in range(50)]


@pytest.mark.parametrize('way', ['ctrl_c', 'q', 'SIGTERM', 'SIGHUP', 'SIGQUIT'])
def test_the_terminal_is_as_before_however_it_ends(tmp_path, listener, replay, way):
    one = replay(write(tmp_path / 'bag', numbers(100, step_ns=S)), terminal=True)
    listener.until(lambda: one.shows(b'playing'))
    assert one.terminal_modes() != one.before
    if way.startswith('SIG'):
        one.interrupt(getattr(signal, way))
    else:
        one.press({'ctrl_c': CTRL_C, 'q': b'q'}[way])
    listener.until_ended(one)
    assert one.terminal_modes() == one.before
    code, _, errors = one.end()
    assert (code, errors) == (130, [])


def test_a_bag_that_is_cut_off_is_played_up_to_there_and_said_so(tmp_path, listener, replay):
    path = tmp_path / 'cut.mcap'
    whole = b''.join(string_message(S + k, str(k)) for k in range(5))
    path.write_bytes(HEAD + CHANNEL + whole + string_message(2 * S, 'lost')[:-3])
    listener.listen('/said', String)
    one = replay(path)
    listener.until_ended(one)
    code, _, (line,) = one.end()
    assert code == 2
    assert str(path) in line
    assert said(listener) == list('01234')


def pair_channel(kind=b'my_msgs/msg/Pair', type_hash=''):
    """Pack schema and channel 2, topic /pair, by hand."""
    schema = struct.pack('<H', 2) + text(kind.decode()) + text('ros2msg') + text('string data\n')
    more = text('topic_type_hash') + text(type_hash)
    channel = struct.pack('<HH', 2, 2) + text('/pair') + text('cdr')
    return record(3, schema) + record(4, channel + struct.pack('<I', len(more)) + more)


@pytest.mark.parametrize(
    ('channel', 'reason'),
    [
        (pair_channel(), "'my_msgs/msg/Pair' is not installed"),
        (pair_channel(b'std_msgs/msg/String', 'RIHS01_' + '5' * 64), 'another version'),
    ],
)
def test_a_topic_whose_type_is_not_here_is_named_and_left_out(
    tmp_path, listener, replay, channel, reason
):
    path = tmp_path / 'own.mcap'
    message = struct.pack('<HIQQ', 2, 0, S, S) + string_cdr('a pair')
    path.write_bytes(
        HEAD + CHANNEL + channel + record(5, message) + string_message(S, 'word') + TAIL
    )
    listener.listen('/said', String)
    listener.listen('/pair', String)
    one = replay(path)
    listener.until_ended(one)
    code, _, (line,) = one.end()
    assert code == 2
    assert '/pair' in line
    assert reason in line
    assert said(listener) == ['word']
    assert said(listener, '/pair') == []


def test_a_live_topic_of_another_type_is_refused_in_one_line(tmp_path, listener, replay):
    listener.listen('/said', Header)
    one = replay(write(tmp_path / 'bag', numbers(3)))
    listener.until_ended(one)
    code, _, (line,) = one.end()
    assert code == 2
    assert '/said is std_msgs/msg/String in the bag but std_msgs/msg/Header' in line
    assert listener.heard == []


def test_a_reader_that_can_not_hear_is_named(tmp_path, listener, replay):
    """A reliable subscriber gets nothing of a best-effort publisher: ROS says nothing."""
    qos = {'/said': qos_yaml('best_effort', 'volatile')}
    listener.listen('/said', String)
    one = replay(write(tmp_path / 'bag', numbers(3), qos))
    listener.until_ended(one)
    _, _, (line,) = one.end()
    assert '/listener gets nothing of /said' in line
    assert 'reliable' in line.lower()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [(['-r', '0'], '--rate'), (['--topics', '/no'], '/no'), (['-p'], '--start-paused')],
)
def test_a_bad_command_is_one_line_and_exit_code_two(tmp_path, replay, arguments, words):
    code, _, (line,) = replay(write(tmp_path / 'bag', numbers(3)), *arguments).end()
    assert code == 2
    assert words in line
