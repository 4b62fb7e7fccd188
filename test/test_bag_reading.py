"""Any bag is read, in the order it was recorded in, and a bad one is refused in one line."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore
from test_bags import CHANNEL, HEAD, TAIL, chunk, record, string_cdr, string_message, text

from layered_cbf_ros.bags.storage.foreign import ForeignBag
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError

FOREVER = QosTime(9223372036, 854775807)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
    FOREVER, FOREVER, QosLiveliness.AUTOMATIC, FOREVER, False,
)  # fmt: skip


def said(bag, **options):
    return [(r.log_time_ns, r.data[8:-1].decode()) for r in bag.in_time_order(**options)]


@pytest.mark.parametrize('closed', [True, False])
@pytest.mark.parametrize('compression', ['', 'lz4', 'zstd'])
def test_messages_come_in_the_order_of_their_log_times(tmp_path, closed, compression):
    """Chunks overlap, the second begins first, one message stands outside of all."""
    path = tmp_path / 'mixed.mcap'
    first = CHANNEL + string_message(30, 'c') + string_message(10, 'a') + string_message(50, 'e')
    second = string_message(20, 'b') + string_message(30, 'd') + string_message(60, 'g')
    path.write_bytes(
        HEAD + chunk(first, compression) + chunk(second, compression) + string_message(55, 'f')
        + (TAIL if closed else b'')
    )  # fmt: skip
    bag = open_bag(path)
    expected = [(10, 'a'), (20, 'b'), (30, 'c'), (30, 'd'), (50, 'e'), (55, 'f'), (60, 'g')]
    assert said(bag) == expected
    assert said(bag, start_ns=30) == expected[2:]
    assert bag.truncated is not closed
    assert bag.counts == {'/said': 5}


def test_the_order_of_a_large_bag_is_that_of_a_stable_sort(tmp_path):
    times = np.random.default_rng(5).integers(0, 10_000, 5_000).tolist()
    with BagWriter(tmp_path / 'bag') as bag:
        topic = bag.add_topic('/said', 'std_msgs/msg/String')
        for k, time in enumerate(times):
            bag.write(topic, string_cdr(f'{k}'), time, time)
            if k % 333 == 0:
                bag.flush()
    expected = [(times[k], f'{k}') for k in np.argsort(times, kind='stable')]
    assert said(open_bag(tmp_path / 'bag')) == expected


def test_topics_are_known_before_a_pass(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/silent', 'std_msgs/msg/String')
        bag.write(bag.add_topic('/said', 'std_msgs/msg/Header'), b'', 1, 1)
    topics = open_bag(tmp_path / 'bag').topics
    assert topics['/said'].type_name == 'std_msgs/msg/Header'
    assert topics['/said'].type_hash.startswith('RIHS01_')
    assert yaml.safe_load(topics['/said'].qos)[0]['reliability'] == 'reliable'


def write_foreign(folder: Path, plugin: StoragePlugin, mode: CompressionMode | None) -> None:
    typestore = get_typestore(Stores.ROS2_JAZZY)
    kind = 'std_msgs/msg/String'
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection(
            '/said', kind, typestore=typestore, offered_qos_profiles=[LATCHED]
        )
        for time, word in ((7, 'one'), (8, 'two')):
            message = typestore.types[kind](data=word)
            writer.write(topic, time, typestore.serialize_cdr(message, kind))


@pytest.mark.parametrize('plugin', [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize('mode', [None, CompressionMode.MESSAGE, CompressionMode.FILE])
def test_bags_of_others_are_read(tmp_path, plugin, mode):
    """Written by rosbags, in each form that rosbag2 knows."""
    if plugin is StoragePlugin.MCAP and mode is not None:
        mode = CompressionMode.STORAGE
    write_foreign(tmp_path / 'bag', plugin, mode)
    bag = open_bag(tmp_path / 'bag')
    assert [(r.log_time_ns, m.data) for r, m in bag.messages()] == [(7, 'one'), (8, 'two')]
    assert said(bag, start_ns=8)[0][0] == 8
    (profile,) = yaml.safe_load(bag.topics['/said'].qos)
    assert (profile['durability'], profile['depth']) == ('transient_local', 1)


def test_a_db3_file_is_a_bag_too(tmp_path):
    write_foreign(tmp_path / 'bag', StoragePlugin.SQLITE3, None)
    (file,) = (tmp_path / 'bag').glob('*.db3')
    bag = open_bag(file)
    assert isinstance(bag, ForeignBag)
    assert [m.data for _, m in bag.messages()] == ['one', 'two']


def test_what_is_no_bag_is_refused_in_one_line(tmp_path):
    spoilt = tmp_path / 'spoilt.db3'
    spoilt.write_bytes(b'SQLite format 3\0' + bytes(5000))
    (tmp_path / 'empty.mcap').touch()
    (tmp_path / 'text.mcap').write_text('a bag of words')
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'half').mkdir()
    (tmp_path / 'half' / 'metadata.yaml').write_text('rosbag2_bagfile_information: {version: 9}')
    for name in ('absent', 'empty.mcap', 'text.mcap', 'folder', 'half', 'spoilt.db3'):
        with pytest.raises(BagError) as refusal:
            list(open_bag(tmp_path / name).records())
        assert str(tmp_path / name) in str(refusal.value)
        assert '\n' not in str(refusal.value)


@pytest.mark.parametrize(
    ('schema', 'hash_text', 'word'),
    [
        ('string data\nstring', '', 'spoilt'),
        ('other_msgs/Absent data\n', '', 'spoilt'),
        ('float64 data\n', '', 'bytes are no'),
        ('string data\n', 'RIHS01_' + '0' * 64, 'another version'),
        ('', '', 'unknown'),
    ],
)
def test_a_wrong_schema_is_one_line_that_names_the_topic(tmp_path, schema, hash_text, word):
    kind = 'own_msgs/msg/Word'
    entries = text('topic_type_hash') + text(hash_text)
    channel = struct.pack('<HH', 1, 1) + text('/said') + text('cdr')
    channel += struct.pack('<I', len(entries)) + entries
    schema_record = struct.pack('<H', 1) + text(kind) + text('ros2msg' if schema else '')
    path = tmp_path / 'odd.mcap'
    path.write_bytes(
        HEAD + record(3, schema_record + text(schema)) + record(4, channel)
        + string_message(1, 'x') + TAIL
    )  # fmt: skip
    with pytest.raises(BagError, match=word) as refusal:
        list(BagReader(path).messages())
    assert '/said' in str(refusal.value)
    assert '\n' not in str(refusal.value)
