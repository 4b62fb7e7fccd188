"""inspect tells what is in a bag, and what is wrong with it in one line each."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
import yaml
from inspecting import (
    CLOCK,
    HEADER,
    LATE_NS,
    Inspector,
    message,
    note,
    stamped,
    topic,
    write,
)
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from test_bags import CHANNEL, HEAD, TAIL, string_cdr, string_message

from layered_cbf_ros.bags.inspection.bag_info import offered_qos
from layered_cbf_ros.bags.inspection.layout import lay_out
from layered_cbf_ros.bags.inspection.stamps import StampTrack
from layered_cbf_ros.bags.recording.losses import TopicLosses, note_of
from layered_cbf_ros.bags.storage.metadata import qos_yaml
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError

MS = 1_000_000
PROGRAM = 'from layered_cbf_ros.nodes.inspect import main; main()'
STRING = 'std_msgs/msg/String'


@pytest.fixture
def inspect(monkeypatch, capsys):
    return Inspector(monkeypatch, capsys)


@pytest.fixture(scope='module')
def synthetic():
    return pytest.importorskip('synthetic_bag', reason='rclpy is not installed')


@pytest.fixture(scope='module')
def walk(synthetic, tmp_path_factory):
    """The bag of a synthetic run, all topics serialised by rclpy."""
    recipe = synthetic.Recipe(duration=1.0, compression='lz4', period_ns=4 * MS)
    return synthetic.write_bag(tmp_path_factory.mktemp('run') / 'bag', recipe)


def rows_of(out: str) -> dict[str, list[str]]:
    """Return the words behind each topic of the table."""
    lines = [line.split() for line in out.splitlines() if line.startswith('  /')]
    return {name: words for name, *words in lines}


def test_counts_and_types_are_those_that_mcap_counts(inspect, walk):
    with (walk / 'bag_0.mcap').open('rb') as stream:
        found = [(c.topic, s.name, m.log_time) for s, c, m in make_reader(stream).iter_messages()]
    counts = Counter(name for name, _, _ in found)
    ended = inspect(walk)
    assert (ended.code, ended.err) == (0, '')
    assert {name: int(words[0]) for name, words in rows_of(ended.out).items()} == counts
    assert {kind for _, kind, _ in found} <= set(ended.out.splitlines())
    assert f'messages  {len(found)} on {len(counts)} topics' in ended.out
    times = [time for _, _, time in found]
    assert f'duration  {(max(times) - min(times)) / 1e9:.3f} s' in ended.out
    size = (walk / 'bag_0.mcap').stat().st_size
    assert f'bag_0.mcap ({size / 1024:.1f} KiB)' in ended.out
    assert 'a1_0 at goal' in ended.out
    assert max(map(len, ended.out.splitlines())) <= 100


def test_rates_and_gaps_are_plain_arithmetic(inspect, tmp_path):
    """Five stamps within 60 ms, one gap of 30 ms, recorded at half the speed."""
    stamps = [0, 10, 20, 30, 60]
    parts = [stamped(1, 5 * 10**9 + t * MS, 2 * t * MS, 'world') for t in stamps]
    path = write(tmp_path / 'five.mcap', topic(1, '/five', HEADER), *parts)
    (told,) = json.loads(inspect(path, '--json').out)['info']['topics']
    assert told['count'] == 5
    assert told['log_rate_hz'] == pytest.approx(4 / 0.120)
    assert told['stamp_rate_hz'] == pytest.approx(4 / 0.060)
    assert told['longest_gap_s'] == pytest.approx(0.030)
    assert told['longest_gap_from_s'] == pytest.approx(5.030)


def test_the_json_document_is_all_there_is(inspect, walk):
    document = json.loads(inspect(walk, '--json').out, parse_constant=pytest.fail)
    assert document['problems'] == document['written'] == []
    assert document['info']['path'] == str(walk)
    assert document['summary']['passed'] is False  # one second is too short to reach a goal
    assert len(document['summary']['trajectory_sha256']) == 64
    assert {t['name'] for t in document['info']['topics']} >= {'/state', '/scenario'}


def test_a_bag_of_something_else_has_no_summary_and_is_sound(inspect, tmp_path):
    path = tmp_path / 'said.mcap'
    path.write_bytes(HEAD + CHANNEL + string_message(1, 'one') + TAIL)
    ended = inspect(path)
    assert (ended.code, ended.err) == (0, '')
    assert 'PASSED' not in ended.out
    assert json.loads(inspect(path, '--json').out)['summary'] is None


@pytest.mark.parametrize(
    ('profile', 'short'),
    [
        (qos_yaml('reliable', 'volatile'), 'reliable'),
        (qos_yaml('best_effort', 'volatile'), 'best effort'),
        (qos_yaml('reliable', 'transient_local'), 'reliable, latched'),
        ('- {reliability: 2, durability: 1}', 'best effort, latched'),  # of older bags
        (qos_yaml() + qos_yaml('best_effort'), 'reliable / best effort'),
        ('', ''),
        ('- [', ''),
    ],
)
def test_offered_quality_is_told_in_short(profile, short):
    assert offered_qos(profile) == short


CLOCKS = topic(1, '/clock', CLOCK)
STAMPS = topic(1, '/stamped', HEADER)
SOUND = [stamped(1, k * MS, k * MS, 'w') for k in range(1, 9)]


def with_a_note(losses: dict[str, TopicLosses]) -> bytes:
    return note('recorder', note_of(losses))


BAD = {
    'no message': ((), b'', 'holds no message'),
    'unknown type': (
        (topic(1, '/odd', 'my_msgs/msg/Odd'), message(1, 1, bytes(8))), b'',
        "/odd: type 'my_msgs/msg/Odd' is unknown",
    ),
    'spoilt definition': (
        (topic(1, '/odd', 'my_msgs/msg/Odd', 'my_msgs/Absent x'), message(1, 1, bytes(8))), b'',
        'is spoilt',
    ),
    'other version': (
        (topic(1, '/odd', STRING, digest='RIHS01_' + '0' * 64), message(1, 1, string_cdr('x'))),
        b'', 'of another version',
    ),
    'misfit': (
        (STAMPS, *SOUND, message(1, 20 * MS, SOUND[0][-8:])), b'',
        '/stamped: 1 of 9 messages are no std_msgs/msg/Header and left out; '
        'the first, 0.019 s after the start, begins with',
    ),
    'clock jumps': (
        (CLOCKS, *(stamped(1, t * MS, k * MS) for k, t in enumerate((900, 910, 905, 915)))), b'',
        '/clock: stamps jump back from 0.910 to 0.905 s, 0.002 s after the start',
    ),
    'stamps jump': (
        (STAMPS, *(stamped(1, t * MS, t * MS, 'w') for t in (5000, 6000)),
         stamped(1, 2000 * MS, 6500 * MS, 'w')), b'',
        '/stamped: stamps jump back from 6.000 to 2.000 s, 1.500 s after the start',
    ),
    'log time jumps': (
        (STAMPS, *(stamped(1, t * MS, (t if t < 5 else t - 3600_000) * MS, 'w') for t in range(9))),
        b'', '/stamped: log times jump back by 3599.999 s',
    ),
    'losses': (
        (STAMPS, *SOUND), with_a_note({'/stamped': TopicLosses(8, lost=3), '/x': TopicLosses(1)}),
        'the recorder lost 3 messages of /stamped',
    ),
    'refused': (
        (STAMPS, *SOUND), note('recorder_refused', {'/big': 'my_msgs is not installed'}),
        '/big was not recorded: my_msgs is not installed',
    ),
    'spoilt note': (
        (STAMPS, *SOUND), note('recorder', {'/stamped': 'many'}), "note 'recorder' of /stamped",
    ),
}  # fmt: skip


@pytest.mark.parametrize('kind', BAD)
def test_what_is_wrong_is_told_in_one_line(inspect, tmp_path, kind):
    parts, notes, words = BAD[kind]
    path = write(tmp_path / 'bad.mcap', *parts, notes=notes)
    ended = inspect(path)
    assert ended.code == 2
    assert words in ended.problem
    assert str(path) in ended.out
    assert list(tmp_path.iterdir()) == [path]
    assert json.loads(inspect(path, '--json').out)['problems'] == [ended.problem[len('ERROR ') :]]


def test_a_length_out_of_all_proportion_is_not_believed(inspect, tmp_path):
    """A flipped bit makes 4 GB of a map's length: that topic is lost, time is not."""
    spoilt = bytearray(CHANNEL)
    spoilt[-4:] = b'\0\xff\xff\xff'
    path = write(tmp_path / 'spoilt.mcap', bytes(spoilt), string_message(1, 'one'))
    ended = inspect(path)
    assert (ended.code, 'cut off' in ended.problem) == (2, True)


def test_sent_again_or_out_of_step_is_no_jump(inspect, tmp_path):
    """Senders repeat what seems lost; two senders of one topic are never quite in step."""
    stamps = [1000, 1001, 1002, 1003, 1001, 1002, 1003, 1004, 1003, 0, 1005, 960, 1006]
    parts = [stamped(1, t * MS, k * MS, 'w') for k, t in enumerate(stamps)]
    ended = inspect(write(tmp_path / 'again.mcap', STAMPS, *parts))
    assert (ended.code, ended.err) == (0, '')


def test_time_begins_anew_behind_a_jump():
    """0.1 s before and 0.1 s behind a jump are 0.2 s; the jump is no gap."""
    track = StampTrack(tolerance_ns=0)
    for t in (*range(5000, 5101, 10), *range(1000, 1101, 10)):
        track.take(t * MS, t * MS)
    assert (track.jumps, track.longest_gap_ns) == (1, 10 * MS)
    assert track.rate == pytest.approx(100.0)


@pytest.mark.parametrize(
    ('left_out', 'words'),
    [
        (('/state', '/diagnostics'), '/state, /diagnostics'),
        (('/obstacles/truth',), '/obstacles/truth'),
    ],
)
def test_topics_that_a_run_must_have_are_named(inspect, synthetic, tmp_path, left_out, words):
    recipe = synthetic.Recipe(duration=0.1, left_out=left_out)
    ended = inspect(synthetic.write_bag(tmp_path / 'bag', recipe))
    assert ended.code == 2
    assert f"a run's bag must have {words}, which it lacks" in ended.problem
    assert 'NOT PASSED' in ended.out


@pytest.fixture(scope='module')
def chunks(tmp_path_factory):
    """A bag of twelve chunks with 17 messages each."""
    folder = tmp_path_factory.mktemp('chunks') / 'bag'
    with BagWriter(folder, 'lz4') as bag:
        said = bag.add_topic('/said', STRING)
        for k in range(204):
            bag.write(said, string_cdr(f'message {k}'), LATE_NS + k, LATE_NS + k)
            if k % 17 == 16:
                bag.flush()
    return folder / 'bag_0.mcap'


def test_cut_anywhere_a_bag_gives_what_is_whole_and_one_line(inspect, chunks, tmp_path):
    """mcap's index of the whole file tells which chunks a cut leaves."""
    whole = chunks.read_bytes()
    with chunks.open('rb') as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    ends = [index.chunk_start_offset + index.chunk_length for index in indexes]
    lengths = np.random.default_rng(8).integers(1, len(whole), 50).tolist()
    path = tmp_path / 'cut.mcap'
    for length in (*lengths, len(whole) - 1, ends[0]):
        path.write_bytes(whole[:length])
        ended = inspect(path)
        reader = BagReader(path)
        list(reader.records())
        assert ended.code == 2, length
        assert 'inspect --repair' in ended.problem, length
        count = int(rows_of(ended.out).get('/said', ['0'])[0])
        assert count == sum(reader.counts.values()) == 17 * sum(end <= length for end in ends)


def test_a_cut_run_is_told_of_and_mended(inspect, walk, tmp_path):
    path = tmp_path / 'cut.mcap'
    path.write_bytes((walk / 'bag_0.mcap').read_bytes()[:-100])
    before = inspect(path)
    assert (before.code, 'cut off' in before.problem) == (2, True)
    assert 'NOT PASSED' in before.out
    mended = inspect(path, '--repair')
    assert (mended.code, mended.err) == (0, '')
    after = inspect(path)
    assert (after.code, after.err) == (0, '')
    assert rows_of(after.out) == rows_of(inspect(walk).out)


def test_messages_are_printed_as_yaml_and_as_json_lines(inspect, walk):
    """Both are what rosbags decodes, arrays complete."""
    with AnyReader([walk], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        connections = [c for c in reader.connections if c.topic == '/state']
        taken = [
            (time, reader.deserialize(data, connection.msgtype))
            for (connection, time, data), _ in zip(
                reader.messages(connections), range(2), strict=False
            )
        ]
    ended = inspect(walk, '--topic', '/state', '--count', '2')
    assert (ended.code, ended.err, ended.out.count('---\n')) == (0, '', 2)
    documents = [d for d in yaml.safe_load_all(ended.out) if d is not None]
    lines = [
        json.loads(line)
        for line in inspect(walk, '--topic', '/state', '--count', '2', '--json').out.splitlines()
    ]
    for (time, expected), document, line in zip(taken, documents, lines, strict=True):
        assert (line['topic'], line['log_time_ns']) == ('/state', time)
        assert line['message'] == document
        assert document['position'] == expected.position.tolist()
        assert document['effort'] == expected.effort.tolist()
        assert document['name'] == expected.name
        assert document['header']['stamp']['nanosec'] == expected.header.stamp.nanosec


def test_a_part_of_the_time_is_taken_from_the_begin_of_the_bag(inspect, chunks):
    """Messages are 1 ns apart."""
    options = ('--topic', '/said', '--start-offset', '5e-9', '--playback-duration', '2e-9')
    assert inspect(chunks, *options).out.split('---') == [
        'data: message 5\n', '\ndata: message 6\n', '\ndata: message 7\n', '\n',
    ]  # fmt: skip


def test_what_is_not_finite_is_null_in_json(inspect, tmp_path):
    kind = 'my_msgs/msg/Pair'
    data = b'\0\1\0\0' + struct.pack('<dd', math.nan, math.inf) + b'\7'
    path = write(
        tmp_path / 'nan.mcap',
        topic(1, '/pair', kind, 'float64 a\nfloat64 b\nuint8[1] c\n'),
        message(1, 1, data),
    )
    line = json.loads(inspect(path, '--topic', '/pair', '--json').out, parse_constant=pytest.fail)
    assert line['message'] == {'a': None, 'b': None, 'c': [7]}
    assert (
        yaml.safe_load(inspect(path, '--topic', '/pair').out.partition('---')[0])['b'] == math.inf
    )


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (('--topic', '/sayd'), "no topic '/sayd'; did you mean '/said'?"),
        (('--topic', '/said', '--count', '0'), '--count is 0'),
        (('--topic', '/said', '--start-offset', 'nan'), '--start-offset is nan'),
        (('--count', '3'), '--topic or --export'),
        (('--export', 'xls'), 'xls'),
        (('--output', 'x'), '--export'),
        (('--topic', '/said', '--plot'), 'give one of them'),
        (('--frobnicate',), 'frobnicate'),
    ],
)
def test_a_bad_command_is_one_line(inspect, chunks, options, words):
    ended = inspect(chunks, *options)
    assert (ended.code, ended.out) == (2, '')
    assert words in ended.problem


def test_a_message_that_cannot_be_printed_is_named_behind_the_others(inspect, tmp_path):
    parts, _, _ = BAD['misfit']
    ended = inspect(write(tmp_path / 'bad.mcap', *parts), '--topic', '/stamped')
    assert ended.out.count('---') == len(SOUND)
    assert (ended.code, '/stamped' in ended.problem) == (2, True)


def test_layouts_are_refused_where_rosbags_refuses_messages(walk):
    """One byte is changed, or the end is cut off: whatever that does, both agree."""
    store = get_typestore(Stores.ROS2_JAZZY)
    rng = np.random.default_rng(2)
    seen: dict[str, bytes] = {}
    for entry in BagReader(walk).records():
        seen.setdefault(entry.topic.type_name, entry.data)
    refused = 0
    for kind, data in seen.items():
        for _ in range(60):
            spoilt = bytearray(data[: rng.integers(1, len(data) + 1)])
            spoilt[rng.integers(0, min(len(spoilt), 200))] = rng.integers(0, 256)
            refusals = []
            for decode in (store.deserialize_cdr, lambda d, k: lay_out(store, k, d)):
                try:
                    decode(bytes(spoilt), kind)
                except (BagError, SerdeError, ValueError) as error:
                    refusals.append(error)
            assert len(refusals) in (0, 2), (kind, refusals)
            refused += len(refusals) // 2
    assert refused > 100


def test_who_reads_only_the_first_line_gets_no_traceback(walk):
    """A pipe that is closed early, as by `head -1`."""
    command = f'"{sys.executable}" -c "{PROGRAM}" {walk} --topic /state | head -1'
    shell = ['bash', '-o', 'pipefail', '-c', command]
    ended = subprocess.run(shell, check=False, capture_output=True, text=True)
    assert (ended.stdout, ended.stderr, ended.returncode) == ('header:\n', '', 0)


def test_a_bag_with_resent_states_has_the_same_verdict(inspect, synthetic, tmp_path):
    """Streaming into growing arrays forgets nothing and keeps nothing twice."""
    hashes = set()
    for repeat in (0, 3):
        recipe = synthetic.Recipe(duration=0.4, repeat_every=repeat)
        bag = synthetic.write_bag(tmp_path / f'bag{repeat}', recipe)
        hashes.add(json.loads(inspect(bag, '--json').out)['summary']['trajectory_sha256'])
    assert len(hashes) == 1


@pytest.fixture(scope='module')
def real_run(tmp_path_factory):
    """The folder of a run of one second of the whole graph."""
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    from live_run import LiveRun

    scenario, folder = 'one_agent_three_obstacles', tmp_path_factory.mktemp('real')
    run = LiveRun(scenario, folder / 'run', '--duration', '1')
    run.end()
    return run.output


def assert_same(one, other, where: str) -> int:
    """Compare a message of mcap_ros2 with one of rosbags; return how many values it has."""
    names = getattr(one, '__slots__', None)
    if names is not None:
        return sum(
            assert_same(getattr(one, name), getattr(other, name), f'{where}.{name}')
            for name in names
        )
    if isinstance(one, list | tuple) and len(one) and hasattr(one[0], '__slots__'):
        pairs = enumerate(zip(one, other, strict=True))
        return sum(assert_same(a, b, f'{where}[{k}]') for k, (a, b) in pairs)
    if isinstance(one, bytes):
        one = np.frombuffer(one, other.dtype)
    if isinstance(one, str | list) and not isinstance(other, np.ndarray):
        assert one == other, where
    else:
        assert np.array_equal(np.asarray(one), np.asarray(other)), where
    return np.size(one)


@pytest.mark.lockstep
def test_two_readers_of_others_find_the_same_in_a_real_bag(real_run):
    """Every field of every message, and as many as metadata.yaml and inspect tell."""
    mcap_ros2 = pytest.importorskip('mcap_ros2.reader')
    bag = real_run / 'bag'
    taken: dict[str, list] = {}
    with AnyReader([bag]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            taken.setdefault(connection.topic, []).append((time, message))
    counts, values = Counter(), 0
    for path in sorted(bag.glob('*.mcap')):
        for entry in mcap_ros2.read_ros2_messages(path):
            time, expected = taken[entry.channel.topic][counts[entry.channel.topic]]
            assert entry.log_time_ns == time
            values += assert_same(entry.ros_msg, expected, entry.channel.topic)
            counts[entry.channel.topic] += 1
    told = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert counts == {
        topic['topic_metadata']['name']: topic['message_count']
        for topic in told['topics_with_message_count']
        if topic['message_count']
    }
    assert (counts['/state'], values > 200_000) == (1001, True)


@pytest.mark.lockstep
def test_a_real_run_is_sound_and_inspected_as_it_was_judged(inspect, real_run, tmp_path):
    document = json.loads(inspect(real_run, '--json', '--plot', tmp_path / 'figures').out)
    assert document['problems'] == []
    judged = json.loads((real_run / 'summary.json').read_text())
    for figure in ('trajectory_sha256', 'max_torque_nm', 'messages', 'falls', 'min_clearance_m'):
        assert document['summary'][figure] == judged[figure]
    assert len(document['written']) == 8
