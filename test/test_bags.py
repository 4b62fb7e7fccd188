"""Bags are what rosbag2 writes, and what is whole in a bag can always be read."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from layered_cbf_ros.bags.recording.topic_counter import TopicCounter, counter_for
from layered_cbf_ros.bags.run.series import JointStates, JointTrajectories, PlannedMotions
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.bags.storage.presets import Storage
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError, LayeredCbfError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.joint_state import JointStateWriter

MAGIC = b'\x89MCAP0\r\n'


def text(value: str) -> bytes:
    return struct.pack('<I', len(value)) + value.encode()


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(body)) + body


def string_cdr(value: str) -> bytes:
    return b'\0\1\0\0' + struct.pack('<I', len(value) + 1) + value.encode() + b'\0'


def string_message(log_ns: int, value: str) -> bytes:
    """Pack an mcap message record of channel 1 by hand."""
    return record(5, struct.pack('<HIQQ', 1, 0, log_ns, max(0, log_ns - 5)) + string_cdr(value))


HEAD = MAGIC + record(1, text('ros2') + text('by hand'))
CHANNEL = record(
    3, struct.pack('<H', 1) + text('std_msgs/msg/String') + text('ros2msg') + text('string data\n')
) + record(4, struct.pack('<HH', 1, 1) + text('/said') + text('cdr') + struct.pack('<I', 0))
TAIL = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC


def chunk(content: bytes, compression: str) -> bytes:
    pack = {'': bytes, 'lz4': lz4.frame.compress, 'zstd': zstandard.compress}[compression]
    packed = pack(content)
    head = struct.pack('<QQQI', 0, 0, len(content), 0) + text(compression)
    return record(6, head + struct.pack('<Q', len(packed)) + packed)


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    """The bag of a synthetic run, all topics serialised by rclpy."""
    synthetic = pytest.importorskip('synthetic_bag', reason='rclpy is not installed')
    recipe = synthetic.Recipe(duration=0.8, compression='lz4')
    return synthetic.write_bag(tmp_path_factory.mktemp('run') / 'bag', recipe)


def test_rosbags_opens_a_bag_and_decodes_every_message(walk):
    """A reader that shares no code with the writer finds what the metadata says."""
    information = yaml.safe_load((walk / 'metadata.yaml').read_text())
    information = information['rosbag2_bagfile_information']
    counts = {
        entry['topic_metadata']['name']: entry['message_count']
        for entry in information['topics_with_message_count']
    }
    found = dict.fromkeys(counts, 0)
    typestore = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([walk], default_typestore=typestore) as reader:
        for connection in reader.connections:
            assert connection.digest == typestore.hash_rihs01(connection.msgtype)
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found[connection.topic] += 1
    assert found == counts
    assert information['version'] == 9
    assert information['message_count'] == sum(counts.values()) > 1000


def test_mcap_opens_a_bag_and_finds_what_rosbag2_would_write(walk):
    with (walk / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        for schema, channel, message in reader.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ('ros2msg', 'cdr')
            assert channel.metadata['topic_type_hash'].startswith('RIHS01_')
            assert yaml.safe_load(channel.metadata['offered_qos_profiles'])[0]['depth'] == 10
            assert message.data[:2] == b'\0\1'
        assert reader.get_summary().statistics.chunk_count >= 1


def test_own_reader_agrees_with_mcap(walk):
    with (walk / 'bag_0.mcap').open('rb') as stream:
        expected = [
            (channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]
    reader = BagReader(walk)
    found = [(r.topic.name, r.log_time_ns, r.publish_time_ns, r.data) for r in reader.records()]
    assert found == expected
    assert not reader.truncated
    assert sum(reader.counts.values()) == len(expected)
    times = [log for _, log, _, _ in expected]
    assert reader.log_span_ns == (min(times), max(times))


@pytest.mark.parametrize('compression', ['', 'lz4', 'zstd'])
@pytest.mark.parametrize('closed', [True, False])
def test_bytes_packed_by_hand_are_read(tmp_path, compression, closed):
    """As the mcap specification lays them out: a chunk, then messages outside of chunks."""
    inside = CHANNEL + string_message(20, 'one') + string_message(10, 'two')
    data = HEAD + chunk(inside, compression) + string_message(30, 'three')
    path = tmp_path / 'hand.mcap'
    path.write_bytes(data + (TAIL if closed else b''))
    reader = BagReader(path)
    said = [(r.log_time_ns, r.publish_time_ns, m.data) for r, m in reader.messages()]
    assert said == [(20, 15, 'one'), (10, 5, 'two'), (30, 25, 'three')]
    assert reader.truncated is not closed
    assert reader.log_span_ns == (10, 30)


def test_unknown_types_are_decoded_by_the_bag_s_own_definition(tmp_path):
    schema = struct.pack('<H', 1) + text('my_msgs/msg/Pair') + text('ros2msg')
    schema += text('int32 a\nint32 b\n')
    channel = struct.pack('<HH', 1, 1) + text('/pair') + text('cdr') + struct.pack('<I', 0)
    message = struct.pack('<HIQQ', 1, 0, 1, 1) + b'\0\1\0\0' + struct.pack('<ii', 3, -4)
    path = tmp_path / 'own.mcap'
    path.write_bytes(HEAD + record(3, schema) + record(4, channel) + record(5, message) + TAIL)
    ((entry, pair),) = open_bag(path).messages()
    assert (entry.topic.name, pair.a, pair.b) == ('/pair', 3, -4)


@pytest.mark.parametrize('compression', ['none', 'lz4'])
def test_a_bag_cut_anywhere_gives_all_whole_chunks(tmp_path, compression):
    """mcap's index of the whole file tells which chunks a cut leaves."""
    with BagWriter(tmp_path / 'bag', compression) as bag:
        topic = bag.add_topic('/said', 'std_msgs/msg/String')
        for k in range(200):
            bag.write(topic, string_cdr(f'message {k}'), k, k)
            if k % 17 == 16:
                bag.flush()
    whole = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    ends = [index.chunk_start_offset + index.chunk_length for index in indexes]
    rng = np.random.default_rng(3)
    cut = tmp_path / 'cut.mcap'
    for length in (0, 5, ends[0], ends[0] - 1, *rng.integers(0, len(whole), 50).tolist()):
        cut.write_bytes(whole[:length])
        reader = BagReader(cut)
        found = [record.log_time_ns for record in reader.records()]
        chunks = sum(end <= length for end in ends)
        assert found == list(range(min(200, 17 * chunks))), length
        assert reader.truncated


def test_a_spoilt_chunk_ends_the_bag_but_not_the_reader(tmp_path):
    """What a disk that lost power leaves: zeros at the end, or a torn chunk."""
    good = HEAD + chunk(CHANNEL + string_message(1, 'one'), 'lz4')
    torn = bytearray(chunk(string_message(2, 'two'), 'lz4'))
    packed = lz4.frame.compress(string_message(2, 'two'))
    torn[-len(packed) :] = bytes(len(packed))
    for tail in (bytes(4096), bytes(torn) + TAIL):
        path = tmp_path / 'spoilt.mcap'
        path.write_bytes(good + tail)
        reader = BagReader(path)
        assert [m.data for _, m in reader.messages()] == ['one']
        assert reader.truncated


KILLED = """
import sys, time
from pathlib import Path
from layered_cbf_ros.bags.storage.writer import BagWriter
bag = BagWriter(Path(sys.argv[1]))
topic = bag.add_topic('/said', 'std_msgs/msg/String')
data = bytes.fromhex(sys.argv[2])
for k in range(300):
    bag.write(topic, data, k, k)
print('written', flush=True)
time.sleep(60)
"""


def test_a_killed_writer_leaves_a_readable_bag(tmp_path):
    """SIGKILL leaves no time to tidy up: whole chunks must be in the file already."""
    data = string_cdr('x' * 10_000)  # 300 of these are just short of three chunks
    environment = {**os.environ, 'PYTHONPATH': str(Path(__file__).resolve().parents[1])}
    command = [sys.executable, '-c', KILLED, tmp_path / 'bag', data.hex()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout.readline() == b'written\n'
        os.kill(process.pid, signal.SIGKILL)
    metadata = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    topics = metadata['rosbag2_bagfile_information']['topics_with_message_count']
    assert [entry['topic_metadata']['name'] for entry in topics] == ['/said']
    reader = BagReader(tmp_path / 'bag')
    found = [record.log_time_ns for record in reader.records()]
    per_chunk = -(-(1 << 20) // (len(data) + 31))  # a chunk ends once it exceeds 1 MiB
    assert len(found) in (2 * per_chunk, 2 * per_chunk - 1)  # the first holds the schema too
    assert found == list(range(len(found)))
    assert reader.truncated


def test_a_bag_is_split_by_time_and_silent_topics_are_told(tmp_path):
    """No file spans more than was asked for, and rosbags reads all as one."""
    with BagWriter(tmp_path / 'bag', storage=Storage(max_seconds=2.0)) as bag:
        topic = bag.add_topic('/said', 'std_msgs/msg/String')
        bag.add_topic('/silent', 'sensor_msgs/msg/Imu')
        for k in range(100):
            bag.write(topic, string_cdr(f'message {k}'), k * NS_PER_S // 10, 0)
    information = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    files = information['rosbag2_bagfile_information']['files']
    assert [entry['message_count'] for entry in files] == [20] * 5
    assert max(entry['duration']['nanoseconds'] for entry in files) < 2 * NS_PER_S
    with AnyReader([tmp_path / 'bag']) as reader:
        said = [reader.deserialize(data, c.msgtype).data for c, _, data in reader.messages()]
        assert {c.topic: c.msgcount for c in reader.connections} == {'/said': 100, '/silent': 0}
    assert said == [f'message {k}' for k in range(100)]
    assert set(BagReader(tmp_path / 'bag').topics) == {'/said', '/silent'}


def test_a_bag_is_never_written_over(tmp_path):
    BagWriter(tmp_path / 'bag').close()
    with pytest.raises(BagError, match='exists already'):
        BagWriter(tmp_path / 'bag')
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagError, match='no mcap file'):
        BagReader(tmp_path / 'empty')
    (tmp_path / 'other.mcap').write_bytes(b'something else')
    with pytest.raises(BagError, match='no mcap file'):
        list(BagReader(tmp_path / 'other.mcap').records())


def test_fast_decoding_agrees_with_rosbags(walk):
    """Every double of three message types, out of rclpy's bytes with their random padding."""
    builders = {
        '/state': JointStates(),
        '/coordinator/barriers': JointTrajectories(),
        '/safe_trajectory': PlannedMotions(),
    }
    expected = {topic: [] for topic in builders}
    for entry, message in BagReader(walk).messages(builders):
        topic = entry.topic.name
        builders[topic].add(entry.data)
        stamp = message.header.stamp
        stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
        if topic == '/state':
            rows = [message.position, message.velocity, message.effort]
            expected[topic].append((stamp_ns, np.array(rows)))
        elif topic == '/coordinator/barriers':
            for p in message.points:
                offset = p.time_from_start
                rows = [p.positions, p.velocities, p.accelerations, p.effort]
                time_ns = stamp_ns + offset.sec * NS_PER_S + offset.nanosec
                expected[topic].append((time_ns, np.array(rows)))
        else:
            (point,) = message.points
            rows = [
                [t.translation.x, t.translation.y, t.translation.z]
                + [t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w]
                + [c for twist in twists for part in (twist.linear, twist.angular)
                   for c in (part.x, part.y, part.z)]
                for t, *twists in zip(
                    point.transforms, point.velocities, point.accelerations, strict=True
                )
            ]  # fmt: skip
            expected[topic].append((stamp_ns, np.array(rows).T))
    for topic, builder in builders.items():
        series = builder.build()
        assert series.stamps_ns.tolist() == [stamp_ns for stamp_ns, _ in expected[topic]]
        assert np.array_equal(series.values, np.stack([rows for _, rows in expected[topic]]))


def test_names_that_come_and_go_leave_gaps_not_shifts():
    builder = JointStates()
    one, two = np.array([1.0]), np.array([2.0, 3.0])
    builder.add(JointStateWriter(['a']).encode(1, one, one, one))
    builder.add(JointStateWriter(['b', 'a']).encode(2, two, two, two))
    series = builder.build()
    assert series.names == ('a', 'b')
    assert np.array_equal(series.values[:, 0], [[1.0, np.nan], [3.0, 2.0]], equal_nan=True)


def test_repeated_stamps_count_once_and_contradictions_are_told():
    builder, writer = JointStates(), JointStateWriter(['a'])
    for stamp_ns, value in ((20, 2.0), (10, 1.0), (20, 2.0), (10, 1.5)):
        builder.add(writer.encode(stamp_ns, *[np.array([value])] * 3))
    series = builder.build()
    assert series.stamps_ns.tolist() == [10, 20]
    assert series.values[:, 0, 0].tolist() == [1.0, 2.0]
    assert series.contradictions == 1


def test_a_message_cut_short_is_refused():
    data = JointStateWriter(['a', 'b']).encode(1, *[np.ones(2)] * 3)
    for length in range(len(data)):
        with pytest.raises(LayeredCbfError):
            JointStates().add(data[:length])


def test_a_message_that_does_not_fit_its_type_is_named(tmp_path):
    path = tmp_path / 'odd.mcap'
    odd = struct.pack('<HIQQ', 1, 0, 1, 1) + string_cdr('said') + bytes(64)
    path.write_bytes(HEAD + CHANNEL + record(5, odd) + TAIL)
    with pytest.raises(BagError, match='/said'):
        list(open_bag(path).messages())


@pytest.mark.parametrize('lost', [(), (5,), (3, 4, 5, 40), tuple(range(10, 60, 2))])
def test_lost_messages_show_as_gaps_between_stamps(lost):
    writer, counter = JointStateWriter(['a']), counter_for('sensor_msgs/msg/JointState')
    for tick in range(200):
        if tick not in lost:
            counter.receive(writer.encode(tick * 1_000_000, *[np.ones(1)] * 3))
    assert (counter.received, counter.lost) == (200 - len(lost), len(lost))


def test_repeated_and_unstamped_messages_are_no_loss():
    writer, counter = JointStateWriter(['a']), TopicCounter(stamped=True)
    for tick in (0, 1, 2, 2, 1, 3):
        counter.receive(writer.encode(tick * 1_000_000, *[np.ones(1)] * 3))
    assert (counter.lost, counter.repeated) == (0, 2)
    unstamped = counter_for('std_msgs/msg/String')
    assert unstamped.receive(string_cdr('ready')) is None
    assert (unstamped.received, unstamped.lost) == (1, 0)
