"""The recorder, as a real process: what was sent is in the bag, or it says what isn't."""

from __future__ import annotations

import itertools
import os
import resource
import shutil
import signal
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

import yaml
from live_node import LiveNode
from live_run import LiveRun
from mcap.reader import make_reader
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Plane
from std_msgs.msg import String

from layered_cbf_ros.bags.recording.losses import TopicLosses, read_losses
from layered_cbf_ros.bags.run.verdict import judge
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.bags.storage.repair import repair

pytestmark = pytest.mark.system

RELIABLE = QoSProfile(depth=2000)
BEST_EFFORT = QoSProfile(depth=2000, reliability=QoSReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=5, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
PAUSE = 0.002  # between messages that nothing may delay [s]


class Recording(LiveNode):
    """A recorder that is told by flags, and publishers with numbered messages."""

    def __init__(self, output: Path, *flags: str, before: str = '') -> None:
        super().__init__('recorder', '--', '--output', str(output), *flags, before=before)
        self.output = output
        self.sent: dict[str, list[str]] = {}

    def publisher(self, topic: str, qos: QoSProfile = RELIABLE):
        return self.node.create_publisher(String, topic, qos)

    def send(self, publisher, count: int = 1, size: int = 10) -> None:
        for _ in range(count):
            sent = self.sent.setdefault(publisher.topic_name, [])
            sent.append(f'{len(sent)} '.ljust(size, 'x'))
            publisher.publish(String(data=sent[-1]))
            time.sleep(PAUSE)

    def until_received(self, count: int) -> None:
        """Wait until it tells to have so many messages, its own diagnostics not counted."""
        self.until(lambda: int(self.figures.get('received', 0)) >= count)

    def found(self) -> dict[str, list[str]]:
        """Return the strings in the bag by topic, as rosbags reads them, in order."""
        found: dict[str, list[str]] = {}
        with AnyReader([self.output], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
            for connection, _, data in bag.messages():
                if connection.msgtype == 'std_msgs/msg/String':
                    text = bag.deserialize(data, connection.msgtype).data
                    found.setdefault(connection.topic, []).append(text)
        found.pop('/ready', None)
        return found

    def losses(self) -> dict[str, TopicLosses]:
        return losses_of(self.output)


def losses_of(bag: Path) -> dict[str, TopicLosses]:
    """Return what the recorder of a bag told."""
    reader = BagReader(bag)
    for _ in reader.records():
        pass
    return read_losses(reader.notes) or {}


@pytest.fixture
def record(tmp_path):
    """Return what starts a recorder, and end those that a failed test has left."""
    started: list[Recording] = []

    def start(*flags: str, before: str = '') -> Recording:
        started.append(Recording(tmp_path / 'bag', *flags, before=before))
        return started[-1]

    yield start
    for recording in started:
        if recording.process.poll() is None:
            recording.process.kill()
            recording.stop()


def information(bag: Path) -> dict:
    return yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def test_what_is_sent_is_in_the_bag_byte_for_byte_as_it_was_offered(record, capfd):
    """Also a type that the package itself never sends, defined by its installed package."""
    live = record()
    said = live.publisher('/said')
    latched = live.publisher('/latched', LATCHED)
    cloud = live.node.create_publisher(PointCloud2, '/cloud', BEST_EFFORT)
    live.until_matched(said, latched, cloud)
    live.send(said, 50)
    live.send(latched, 5)
    clouds = [PointCloud2(width=k, data=bytes(range(k))) for k in range(1, 20)]
    clouds = [serialize_message(cloud) for cloud in clouds]
    for message in clouds:
        cloud.publish(message)
        time.sleep(PAUSE)
    live.until_received(74)
    assert live.stop() == 0
    assert live.found() == live.sent
    recorded = [r.data for r in BagReader(live.output).records(['/cloud'])]
    ends = [data[len(message) :] for data, message in zip(recorded, clouds, strict=True)]
    assert recorded == [message + end for message, end in zip(clouds, ends, strict=True)]
    assert max(map(len, ends)) < 4  # the transport rounds up to whole words
    offers = {
        entry['topic_metadata']['name']: entry['topic_metadata']['offered_qos_profiles'][0]
        for entry in information(live.output)['topics_with_message_count']
    }
    kinds = {name: (q['reliability'], q['durability'], q['history']) for name, q in offers.items()}
    assert kinds['/said'] == ('reliable', 'volatile', 'unknown')
    assert kinds['/latched'] == ('reliable', 'transient_local', 'unknown')
    assert kinds['/cloud'] == ('best_effort', 'volatile', 'unknown')
    said = capfd.readouterr().out
    assert '+ /cloud [sensor_msgs/msg/PointCloud2], best_effort, volatile' in said
    assert 'nothing lost' in said


def test_every_publisher_s_offer_is_stored(record):
    live = record('/both')
    publishers = [live.publisher('/both'), live.publisher('/both', LATCHED)]
    live.until_matched(*publishers)
    for publisher in publishers:
        live.send(publisher, 3)
    live.until_received(6)
    assert live.stop() == 0
    (entry,) = information(live.output)['topics_with_message_count']
    offers = entry['topic_metadata']['offered_qos_profiles']
    assert sorted(offer['durability'] for offer in offers) == ['transient_local', 'volatile']
    assert sorted(live.found()['/both']) == sorted(live.sent['/both'])


@pytest.mark.parametrize(
    ('flags', 'wanted'),
    [
        (['/a', '/b/c'], {'/a', '/b/c'}),
        (['--topics', 'a'], {'/a'}),
        (['-e', '^/b'], {'/b/c', '/b/d'}),
        (['/a', '-e', 'c$'], {'/a', '/b/c'}),
        (['-e', '/[ab]', '-x', 'd$'], {'/a', '/b/c'}),
        (['-a', '-x', 'ready|diag|rosout|param', '--exclude-topics', '/a'], {'/b/c', '/b/d'}),
    ],
)
def test_topics_are_chosen_by_name_and_pattern(record, flags, wanted):
    live = record(*flags)
    topics = {'/a', '/b/c', '/b/d', '/_hidden'}
    publishers = {topic: live.publisher(topic) for topic in topics}
    live.until_matched(*(publishers[topic] for topic in wanted))
    for publisher in publishers.values():
        live.send(publisher, 2)
    live.until_received(2 * len(wanted))
    assert live.stop() == 0
    assert live.found() == {topic: live.sent[topic] for topic in wanted}


def test_what_was_sent_before_the_recorder_came_is_no_loss_but_told(record):
    live = record('/early')
    early = live.publisher('/early')
    for _ in range(7):  # faster than anyone can subscribe
        early.publish(String(data='too early'))
    assert not early.get_subscription_count()
    live.until_matched(early)
    live.send(early, 5)
    live.until_received(5)
    assert live.stop() == 0
    losses = live.losses()['/early']
    assert (losses.received, losses.missed_before, losses.lost) == (5, 7, 0)


def test_lost_messages_are_counted_exactly_and_told_everywhere(record, capfd):
    """A stopped recorder can't read, and a publisher of depth 10 doesn't wait."""
    live = record('/fast', '/slow')
    fast = live.publisher('/fast', QoSProfile(depth=10))
    slow = live.publisher('/slow')
    live.until_matched(fast, slow)
    live.send(fast, 20)
    live.send(slow, 20)
    live.until_received(40)
    live.process.send_signal(signal.SIGSTOP)
    for k in range(3000):
        fast.publish(String(data=f'unheard {k}'))
    live.process.send_signal(signal.SIGCONT)
    live.send(slow, 5)
    live.send(fast, 20)
    live.until(lambda: int(live.figures.get('lost', 0)) > 0)
    live.send(fast, 20)
    live.until_received(85)
    assert live.stop() == 1
    received = len(live.found()['/fast'])
    lost = 3060 - received
    assert lost > 1000
    assert live.losses()['/fast'].lost == lost
    assert live.losses()['/slow'].lost == 0
    assert int(live.figures['lost']) == lost
    assert f'{lost} LOST on /fast' in capfd.readouterr().out
    assert f'{lost} LOST' in information(live.output)['custom_data']['recorder']


def test_a_lossy_recording_fails_the_verdict_on_its_run(record):
    live = record('/fast')
    fast = live.publisher('/fast', QoSProfile(depth=10))
    live.until_matched(fast)
    live.send(fast, 5)
    live.until_received(5)
    live.process.send_signal(signal.SIGSTOP)
    for k in range(2000):
        fast.publish(String(data=f'unheard {k}'))
    live.process.send_signal(signal.SIGCONT)
    live.until(lambda: int(live.figures.get('lost', 0)) > 0, lambda: live.send(fast))
    assert live.stop() == 1
    verdict = judge(live.output)
    lost = live.losses()['/fast'].lost
    assert not verdict.passed
    assert f'the recorder lost {lost} messages of /fast' in verdict.reasons


def test_in_lockstep_a_recorder_that_is_held_up_loses_nothing(tmp_path):
    """The simulator waits for it, and whatever went past it is sent again."""
    scenario = tmp_path / 'stand.yaml'
    scenario.write_text(
        'description: One A1 stands.\nduration: 4.0\n'
        'robots:\n  - {name: a1_0, position: [0.0, 0.0], gait: stand}\n'
    )
    run = LiveRun(scenario, tmp_path / 'run')
    run.until_running()
    for _ in range(2):
        os.kill(run.children['/recorder'], signal.SIGSTOP)
        time.sleep(1.0)
        os.kill(run.children['/recorder'], signal.SIGCONT)
        time.sleep(0.3)
    assert run.end() == 0, run.said
    losses = losses_of(tmp_path / 'run' / 'bag')
    assert losses['/state'].received - losses['/state'].repeated == 4001
    assert not any(each.lost for each in losses.values())
    assert not any(each.stamp_gaps for each in losses.values())


def test_sequences_of_the_bag_are_the_publisher_s(record):
    live = record('/said')
    said = live.publisher('/said')
    live.until_matched(said)
    live.send(said, 30)
    live.until_received(30)
    live.stop()
    assert [r.sequence for r in BagReader(live.output).records()] == list(range(1, 31))


def test_a_publisher_that_offers_less_and_comes_later_is_recorded_too(record, capfd):
    live = record('/said')
    reliable = live.publisher('/said')
    live.until_matched(reliable)
    live.send(reliable, 30)
    weaker = live.publisher('/said', BEST_EFFORT)
    live.until(lambda: weaker.get_subscription_count() > 0, lambda: live.send(reliable))
    before = len(live.sent['/said'])
    for _ in range(400):  # both, through the change of subscription
        live.send(reliable)
        live.send(weaker)
    live.until_received(before + 800)
    assert live.stop() == 0
    assert Counter(live.found()['/said']) == Counter(live.sent['/said'])
    assert 'a publisher offers less; subscribed anew, best_effort' in capfd.readouterr().out


def test_a_type_that_is_not_installed_is_refused_once_and_named(record, capfd):
    live = record('-e', '/said|/plane', before="import sys; sys.modules['shape_msgs.msg'] = None")
    said = live.publisher('/said')
    plane = live.node.create_publisher(Plane, '/plane', 10)
    live.until_matched(said)
    live.until(lambda: bool(live.figures.get('dropped_topics')))
    live.send(said, 3)
    live.until_received(3)
    plane.publish(Plane())
    assert live.process.poll() is None
    live.process.send_signal(signal.SIGINT)
    error = live.process.stderr.read()
    assert live.stop() == 1
    assert error.count('NOT RECORDED /plane') == 1
    assert "'shape_msgs/msg/Plane' is not installed; install the package shape_msgs" in error
    assert 'NOT RECORDED: /plane' in capfd.readouterr().out
    assert live.found() == live.sent


@pytest.mark.parametrize(
    ('preset', 'compression'),
    [
        ('none', ''),
        ('fastwrite', ''),
        ('lz4', 'lz4'),
        ('zstd_fast', 'zstd'),
        ('zstd_small', 'zstd'),
    ],
)
def test_presets_are_stored_as_named(record, preset, compression):
    live = record('/said', '--storage-preset-profile', preset)
    said = live.publisher('/said')
    live.until_matched(said)
    live.send(said, 100, size=1000)
    live.until_received(100)
    assert live.stop() == 0
    assert live.found() == live.sent
    (path,) = live.output.glob('*.mcap')
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert {index.compression for index in reader.get_summary().chunk_indexes} == {compression}
    assert (path.stat().st_size < 50_000) is bool(compression)


def test_a_split_bag_is_one_bag_and_each_file_is_whole(record):
    live = record('/said', '/rare', '-b', '100000', '--storage-preset-profile', 'none')
    said, rare = live.publisher('/said'), live.publisher('/rare', LATCHED)
    live.until_matched(said, rare)
    live.send(rare, 2)
    live.send(said, 400, size=1000)
    live.until_received(402)
    assert live.stop() == 0
    files = information(live.output)['files']
    assert [entry['path'] for entry in files] == [f'bag_{k}.mcap' for k in range(len(files))]
    assert len(files) >= 4
    assert live.found() == live.sent
    for entry in files:
        path = live.output / entry['path']
        assert path.stat().st_size < 110_000
        with path.open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True)
            times = [message.log_time for _, _, message in reader.iter_messages()]
            summary = reader.get_summary()
        assert len(times) == entry['message_count'] == summary.statistics.message_count
        assert min(times) == entry['starting_time']['nanoseconds_since_epoch']
        assert max(times) - min(times) == entry['duration']['nanoseconds']


def test_a_full_disk_ends_the_recording_with_one_line_and_a_whole_bag(record):
    """The limit of a process on the size of files stands for a full disk."""
    live = record('/said', '--storage-preset-profile', 'none', '--chunk-size', '50000')
    said = live.publisher('/said')
    live.until_matched(said)
    resource.prlimit(live.process.pid, resource.RLIMIT_FSIZE, (300_000, 300_000))
    end = time.monotonic() + 30.0
    while live.process.poll() is None:
        assert time.monotonic() < end
        live.send(said, size=1000)
    error = live.process.stderr.read().strip().splitlines()
    assert live.stop() == 2
    assert len(error) == 1
    assert 'bag_0.mcap cannot be written: File too large' in error[0]
    assert 'make room' in error[0]
    found = live.found()['/said']
    assert len(found) > 100
    assert found == live.sent['/said'][: len(found)]
    assert information(live.output)['message_count'] == len(found)
    assert any('the recorder failed' in reason for reason in judge(live.output).reasons)


def test_a_bag_that_is_moved_goes_on_where_it_went(record, tmp_path):
    live = record('/said', '-b', '100000', '--storage-preset-profile', 'none')
    said = live.publisher('/said')
    live.until_matched(said)
    live.send(said, 50, size=1000)
    live.until_received(50)
    live.output = live.output.rename(tmp_path / 'elsewhere')
    live.send(said, 150, size=1000)
    live.until_received(200)
    assert live.stop() == 0
    assert live.found() == live.sent
    assert len(list(live.output.glob('*.mcap'))) > 1
    assert not (tmp_path / 'bag').exists()


def test_a_bag_that_is_deleted_is_put_back(record):
    live = record('/said')
    said = live.publisher('/said')
    live.until_matched(said)
    live.send(said, 50)
    live.until_received(50)
    shutil.rmtree(live.output)
    live.send(said, 50)
    live.until((live.output / 'metadata.yaml').exists, lambda: live.send(said))
    live.send(said, 50)
    live.until_received(len(live.sent['/said']))
    live.process.send_signal(signal.SIGINT)
    assert 'was deleted while recording; it was put back' in live.process.stderr.read()
    assert live.stop() == 0
    assert live.found() == live.sent


def test_a_killed_recorder_leaves_all_but_its_last_chunk(record):
    live = record('/said')
    said = live.publisher('/said', QoSProfile(depth=5000))
    live.until_matched(said)
    numbers = itertools.count()
    data = [np.random.default_rng(0).bytes(300).hex() for _ in range(100)]

    def burst() -> None:
        for _ in range(100):
            k = next(numbers)
            live.sent.setdefault('/said', []).append(f'{k} {data[k % 100]}')
            said.publish(String(data=live.sent['/said'][-1]))

    live.until(lambda: int(live.figures.get('received', 0)) > 5000, burst)
    told = int(live.figures['received'])
    os.kill(live.process.pid, signal.SIGKILL)
    live.stop()
    before = [r.data for r in BagReader(live.output).records()]
    assert repair(live.output).changed
    assert [r.data for r in BagReader(live.output).records()] == before
    found = live.found()['/said']
    assert found == live.sent['/said'][: len(found)]
    assert len(found) >= told  # what it told to have was written first


@pytest.mark.parametrize(
    ('flags', 'words'),
    [
        (['-e', '['], "regex is '['"),
        (['-b', '10'], 'max_bag_size is 10'),
        (['--chunk-size', '1'], 'chunk_size'),
        ([], 'exists already'),
    ],
)
def test_a_bad_command_is_one_clear_line_and_harms_nothing(record, tmp_path, flags, words):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'precious.txt').write_text('mine')
    for force in ([], ['--force']):
        live = record(*flags, *force)
        code = live.process.wait(30.0)
        lines = live.process.stderr.read().strip().splitlines()
        live.stop()
        assert code == 2
        assert len(lines) == 1
        assert words in lines[0]
        assert (tmp_path / 'bag' / 'precious.txt').read_text() == 'mine'


def test_force_replaces_a_bag(record):
    for text in ('first', 'second'):
        live = record('/said', '--force')
        said = live.publisher('/said')
        live.until_matched(said)
        said.publish(String(data=text))
        live.until_received(1)
        assert live.stop() == 0
    assert live.found() == {'/said': ['second']}
