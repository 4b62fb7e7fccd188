"""A bag that was cut off anywhere is finished without losing a message that was there."""

from __future__ import annotations

import struct
import subprocess
import sys
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from layered_cbf_ros.bags.storage.presets import Storage
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.bags.storage.repair import repair
from layered_cbf_ros.bags.storage.schemas import load_schema
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError

STRING = 'std_msgs/msg/String'
CUTS = 50
ROOT = Path(__file__).resolve().parents[1]


def string_cdr(value: str) -> bytes:
    return b'\0\1\0\0' + struct.pack('<I', len(value) + 1) + value.encode() + b'\0'


def write_own(folder: Path, preset: str = 'lz4', count: int = 200, **storage) -> Path:
    """Two topics; a chunk ends now and then, the second topic is not in every chunk."""
    bag = BagWriter(folder, storage=Storage(preset, **storage))
    said, heard = (bag.add_topic(name, STRING) for name in ('/said', '/heard'))
    for k in range(count):
        bag.write(said if k % 20 < 15 else heard, string_cdr(f'message {k}'), 10 * k + 5, 10 * k, k)
        if k % 17 == 16:
            bag.flush()
    bag.note('recorder', {'/said': 'received=150'})
    bag.close()
    return folder


def write_foreign(folder: Path, **options) -> Path:
    """The same by the library that defines mcap, as another recorder would."""
    folder.mkdir()
    with (folder / f'{folder.name}_0.mcap').open('wb') as stream:
        writer = Writer(stream, chunk_size=1000, **options)
        writer.start(profile='ros2', library='another recorder')
        schema = writer.register_schema(STRING, 'ros2msg', load_schema(STRING).definition.encode())
        channels = [writer.register_channel(name, 'cdr', schema, {}) for name in ('/a', '/b')]
        for k in range(200):
            data = string_cdr(f'message {k}')
            writer.add_message(channels[k % 3 == 0], 10 * k + 5, data, 10 * k, k)
        writer.add_attachment(5, 5, 'a photo', 'image/png', b'not really')
        writer.add_metadata('robot', {'name': 'a1_0'})
        writer.finish()
    return folder


def found_by_us(bag: Path) -> list[tuple]:
    return [(r.topic.name, r.log_time_ns, r.sequence, r.data) for r in BagReader(bag).records()]


def found_by_mcap(path: Path) -> list[tuple]:
    with path.open('rb') as stream:
        return [
            (channel.topic, message.log_time, message.sequence, message.data)
            for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages(
                log_time_order=False
            )
        ]


def check_index(path: Path) -> None:
    """Look at the end of a file as the specification of mcap has it; readers look less hard."""
    data = path.read_bytes()
    footer = len(data) - 8 - 29  # head, two offsets and a checksum, before the last magic
    summary_at, _, checksum = struct.unpack_from('<QQI', data, footer + 9)
    assert zlib.crc32(data[summary_at : footer + 25]) == checksum
    with path.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    for chunk in summary.chunk_indexes:
        assert data[chunk.chunk_start_offset] == 6
        at = chunk.chunk_start_offset + chunk.chunk_length
        ends = [at]
        for channel, offset in chunk.message_index_offsets.items():
            opcode, length, found = struct.unpack_from('<BQH', data, offset)
            assert (opcode, found) == (7, channel)
            ends.append(offset + 9 + length)
        assert max(ends) - at == chunk.message_index_length


def found_by_rosbags(bag: Path) -> list[tuple]:
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        return [
            (connection.topic, time, reader.deserialize(data, connection.msgtype).data)
            for connection, time, data in reader.messages()
        ]


def decoded(messages: list[tuple]) -> list[tuple]:
    """Return messages as rosbags finds them: strings, in the order of time."""
    return sorted(
        ((topic, time, data[8:-1].decode()) for topic, time, _, data in messages),
        key=lambda message: message[1],
    )


def cuts_in_indexes(path: Path) -> list[int]:
    """Return places behind the first of several message indexes of some chunks, and in the next."""
    with path.open('rb') as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    several = [sorted(c.message_index_offsets.values()) for c in chunks][:6]
    return [
        second + more for _, second, *_ in filter(lambda o: len(o) > 1, several) for more in (0, 9)
    ]


WRITERS = {
    'own': write_own,
    'own, not compressed': lambda folder: write_own(folder, 'none'),
    'zstd': lambda folder: write_foreign(folder, compression=CompressionType.ZSTD),
    'without chunks': lambda folder: write_foreign(folder, use_chunking=False),
}


@pytest.mark.parametrize('writer', WRITERS)
def test_wherever_a_bag_is_cut_all_that_is_whole_is_found_again(tmp_path, writer):
    """Three readers that share no code agree with what could be read before."""
    whole = WRITERS[writer](tmp_path / 'whole') / 'whole_0.mcap'
    data = whole.read_bytes()
    rng = np.random.default_rng(5)
    within = cuts_in_indexes(whole)
    for length in (0, 8, 30, len(data) - 1, *within, *rng.integers(0, len(data), CUTS).tolist()):
        bag = tmp_path / f'cut_{length}'
        bag.mkdir(exist_ok=True)
        cut = bag / 'cut_0.mcap'
        cut.write_bytes(data[:length])
        expected = found_by_us(cut)
        report = repair(bag)
        assert report.changed
        assert sum(file.messages for file in report.files) == len(expected)
        assert found_by_us(bag) == expected, length
        assert not reader_of(bag).truncated
        assert found_by_mcap(cut) == expected, length
        check_index(cut)
        assert found_by_rosbags(bag) == decoded(expected), length
        assert not repair(bag).changed


def reader_of(bag: Path) -> BagReader:
    """Return a reader that has been through a bag."""
    reader = BagReader(bag)
    for _ in reader.records():
        pass
    return reader


def test_what_other_recorders_store_beside_messages_is_kept(tmp_path):
    bag = write_foreign(tmp_path / 'bag')
    path = bag / 'bag_0.mcap'
    path.write_bytes(path.read_bytes()[:-40])  # footer and end of the summary
    repair(bag)
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        (photo,), (robot,) = reader.iter_attachments(), reader.iter_metadata()
    assert (photo.name, photo.data) == ('a photo', b'not really')
    assert (robot.name, robot.metadata) == ('robot', {'name': 'a1_0'})


def test_a_whole_bag_is_left_untouched(tmp_path):
    bag = write_own(tmp_path / 'bag')
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in bag.iterdir()}
    report = repair(bag)
    assert not report.changed
    assert 'whole' in ' '.join(report.lines())
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in bag.iterdir()} == before


def test_the_metadata_follows_from_the_files(tmp_path):
    bag = write_own(tmp_path / 'bag', max_bytes=2000)
    path = bag / 'metadata.yaml'
    right = yaml.safe_load(path.read_text())
    assert len(right['rosbag2_bagfile_information']['files']) > 3
    for spoilt in (None, '', 'rosbag2_bagfile_information: [', 'message_count: 3'):
        if spoilt is None:
            path.unlink()
        else:
            path.write_text(spoilt)
        assert repair(bag).metadata_written
        assert yaml.safe_load(path.read_text()) == right


def test_a_bag_of_several_files_is_finished_where_it_was_cut(tmp_path):
    bag = write_own(tmp_path / 'bag', max_bytes=2000)
    *_, last = sorted(bag.glob('*.mcap'), key=lambda file: (len(file.name), file.name))
    last.write_bytes(last.read_bytes()[:-100])
    expected = found_by_us(bag)
    report = repair(bag)
    assert [file.was_whole for file in report.files] == [True] * (len(report.files) - 1) + [False]
    assert found_by_rosbags(bag) == decoded(expected)
    assert len(expected) == 200


@pytest.mark.parametrize('preset', ['none', 'lz4'])
def test_a_spoilt_chunk_in_the_middle_costs_no_other_message(tmp_path, preset):
    bag = write_own(tmp_path / 'bag', preset)
    path = bag / 'bag_0.mcap'
    with path.open('rb') as stream:
        index = make_reader(stream).get_summary().chunk_indexes[3]
    data = bytearray(path.read_bytes())
    middle = index.chunk_start_offset + index.chunk_length // 2
    data[middle : middle + 60] = bytes(60)
    path.write_bytes(data)
    expected = found_by_us(bag)
    assert 180 <= len(expected) < 200
    report = repair(bag)
    assert report.files[0].set_aside >= index.chunk_length
    assert sorted(found_by_us(bag)) == sorted(expected)
    assert sorted(found_by_mcap(path)) == sorted(expected)
    assert found_by_rosbags(bag) == decoded(expected)
    assert not repair(bag).changed


def test_a_bag_that_is_being_recorded_is_not_touched(tmp_path):
    bag = BagWriter(tmp_path / 'bag')
    topic = bag.add_topic('/said', STRING)
    bag.write(topic, string_cdr('one'), 1, 1)
    bag.flush()
    with pytest.raises(BagError, match='being recorded'):
        repair(tmp_path / 'bag')
    bag.write(topic, string_cdr('two'), 2, 2)
    bag.close()
    assert not repair(tmp_path / 'bag').changed
    assert [data[8:11] for *_, data in found_by_us(tmp_path / 'bag')] == [b'one', b'two']


def test_without_room_the_bag_stays_as_it_was_and_one_line_says_so(tmp_path):
    """The limit of a process on the size of files stands for a full disk."""
    bag = write_own(tmp_path / 'bag')
    path = bag / 'bag_0.mcap'
    with path.open('rb') as stream:
        index = make_reader(stream).get_summary().chunk_indexes[-1]
    cut = index.chunk_start_offset + index.chunk_length + index.message_index_length
    path.write_bytes(path.read_bytes()[:cut])
    expected = found_by_us(bag)
    code = f"""
import resource
from pathlib import Path
from layered_cbf_ros.bags.storage.repair import repair
resource.setrlimit(resource.RLIMIT_FSIZE, ({cut + 50}, {cut + 50}))
repair(Path({str(bag)!r}))
"""
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False, cwd=ROOT
    )
    error = done.stderr.strip().splitlines()[-1]
    assert 'bag_0.mcap cannot be repaired: File too large; make room' in error
    assert path.stat().st_size == cut
    assert found_by_us(bag) == expected
    assert repair(bag).changed
    assert found_by_mcap(path) == expected


def test_what_is_no_mcap_bag_is_refused_and_left_alone(tmp_path):
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagError, match='no mcap file'):
        repair(tmp_path / 'empty')
    other = tmp_path / 'other.mcap'
    other.write_bytes(b'something else')
    with pytest.raises(BagError, match='no mcap file'):
        repair(other)
    assert other.read_bytes() == b'something else'


def test_a_large_bag_is_repaired_in_little_memory(tmp_path):
    rng = np.random.default_rng(0)
    with BagWriter(tmp_path / 'bag') as bag:
        topic = bag.add_topic('/said', STRING)
        data = string_cdr('x' * 20_000)
        for k in range(2_000):  # 40 MB
            bag.write(topic, data[:8] + rng.bytes(20_000) + b'\0', k, k)
    path = tmp_path / 'bag' / 'bag_0.mcap'
    with path.open('r+b') as stream:
        stream.truncate(path.stat().st_size - 500)
    tracemalloc.start()
    try:
        report = repair(tmp_path / 'bag')
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert report.files[0].messages == 2_000
    assert peak < 8e6  # a few chunks of 1 MiB
