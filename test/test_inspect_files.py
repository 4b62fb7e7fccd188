"""What inspect writes: tables that hold every value, figures, a page that needs nothing else."""

from __future__ import annotations

import base64
import csv
import dataclasses
import json
import struct
from html.parser import HTMLParser

import numpy as np
import pytest
from inspecting import Inspector, message, topic, write
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from layered_cbf_ros.bags.inspection import tables

KINDS = ('csv', 'parquet')


@pytest.fixture
def inspect(monkeypatch, capsys):
    return Inspector(monkeypatch, capsys)


@pytest.fixture(scope='module')
def synthetic():
    return pytest.importorskip('synthetic_bag', reason='rclpy is not installed')


@pytest.fixture(scope='module')
def walk(synthetic, tmp_path_factory):
    recipe = synthetic.Recipe(duration=1.0, compression='lz4', period_ns=4_000_000)
    return synthetic.write_bag(tmp_path_factory.mktemp('run') / 'bag', recipe)


def fields_of(value):
    """Yield the names of a message's fields; constants are none."""
    for field in dataclasses.fields(value):
        if not field.type.startswith('ClassVar'):
            yield field.name, getattr(value, field.name)


def flat(value, label, names):
    """Return label and value of every leaf; entries of an array of the names' length go by them."""
    if dataclasses.is_dataclass(value):
        parts = [(f'{label}.{name}', inner) for name, inner in fields_of(value)]
        return [leaf for name, inner in parts for leaf in flat(inner, name, ())]
    if isinstance(value, list | np.ndarray):
        keys = names if len(value) == len(names) else range(len(value))
        entries = zip(keys, value, strict=True)
        return [leaf for key, inner in entries for leaf in flat(inner, f'{label}.{key}', ())]
    return [(label, value)]


def expected_rows(name_field, decoded):
    """Return what a message must become: one row, or one of each point."""
    names = getattr(decoded, name_field, ())
    shared, points = [], [[]]
    for name, value in fields_of(decoded):
        if name == 'points':
            points = [
                [('point', k)]
                + [leaf for n, v in fields_of(p) for leaf in flat(v, f'points.{n}', names)]
                for k, p in enumerate(value)
            ]
        elif name != name_field:
            shared += flat(value, name, names)
    return [dict(shared) | dict(point) for point in points]


def read_rows(path):
    if path.suffix == '.csv':
        with path.open(newline='') as stream:
            return list(csv.DictReader(stream))
    from pyarrow import parquet

    return parquet.read_table(path).to_pylist()


def same(written, value):
    """Compare a cell with a decoded value; every digit of a number in a CSV counts."""
    if isinstance(written, str) and not isinstance(value, str):
        return type(value)(float(written)) == value if '.' in written else int(written) == value
    return written == value


def compare(rows, expected):
    """Compare every cell; return how many there were."""
    assert len(rows) == len(expected)
    for row, wanted in zip(rows, expected, strict=True):
        assert set(row) == set(wanted) | {'publish_time_ns'}
        for label, value in wanted.items():
            assert same(row[label], value), label
    return len(rows) * len(expected[0])


@pytest.mark.parametrize('kind', KINDS)
def test_every_value_of_every_message_is_in_a_table(inspect, walk, tmp_path, kind):
    """rosbags decodes the same messages; trajectories have ten points each, so ten rows."""
    if kind == 'parquet':
        pytest.importorskip('pyarrow')
    ended = inspect(walk, '--export', kind, '--output', tmp_path / 'tables')
    assert (ended.code, ended.err) == (0, '')
    checked = 0
    with AnyReader([walk], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection in reader.connections:
            fields = {name for name, _ in reader.typestore.fielddefs[connection.msgtype][1]}
            name_field = next((n for n in ('name', 'joint_names') if n in fields), '')
            expected = {}
            for _, time, data in reader.messages([connection]):
                decoded = reader.deserialize(data, connection.msgtype)
                for row in expected_rows(name_field, decoded):
                    expected.setdefault(tuple(row), []).append({'log_time_ns': time, **row})
            stem = connection.topic.strip('/').replace('/', '.')
            for number, group in enumerate(expected.values(), 1):
                name = f'{stem}.{number}.{kind}' if number > 1 else f'{stem}.{kind}'
                checked += compare(read_rows(tmp_path / 'tables' / name), group)
    assert checked > 50_000


WORDS = 'string[] name\nfloat64[] position\nuint8[] picture\nbool on\nint16 low\n'


def words(number, names, positions, picture=b'', low=-3):
    """Pack a message of WORDS by hand."""
    data = struct.pack('<I', len(names))
    for name in names:
        data += bytes(-len(data) % 4) + struct.pack('<I', len(name) + 1) + name.encode() + b'\0'
    data += bytes(-len(data) % 4) + struct.pack('<I', len(positions))
    data += bytes(-len(data) % 8 if positions else 0)
    data += struct.pack(f'<{len(positions)}dI', *positions, len(picture)) + picture + b'\1'
    data += bytes(len(data) % 2) + struct.pack('<h', low)
    return message(1, number, b'\0\1\0\0' + data)


@pytest.mark.parametrize('kind', KINDS)
def test_messages_with_other_columns_go_into_another_file(inspect, tmp_path, kind):
    """Names are columns wherever they stand; without names of their own entries are counted."""
    if kind == 'parquet':
        pytest.importorskip('pyarrow')
    parts = [
        words(0, 'ab', [1.5, -2.0]),
        words(1, 'abc', [1.0, 2.0, 3.0]),
        words(2, 'ab', [0.1, 2.5], low=7),
        words(3, '', [0.25]),
        words(4, 'aa', [4.0, 5.0]),
        words(5, 'ab', [0.0, 0.0], bytes(range(256)) * 2),
    ]
    bag = write(tmp_path / 'w.mcap', topic(1, '/w/x', 'my_msgs/msg/Words', WORDS), *parts)
    ended = inspect(bag, '--export', kind)
    assert (ended.code, ended.err) == (0, '')
    folder = tmp_path / f'w_{kind}'
    names = [f'w.x.{kind}', *(f'w.x.{k}.{kind}' for k in (2, 3, 4, 5))]
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    found = [read_rows(folder / name) for name in names]
    assert [[float(r['position.b']) for r in rows] for rows in found[:2]] == [[-2.0, 2.5], [2.0]]
    assert [int(row['low']) for row in found[0]] == [-3, 7]
    assert [float(row['position.0']) for row in found[2]] == [0.25]
    assert [(row['name.1'], float(row['position.1'])) for row in found[3]] == [('a', 5.0)]
    (long,) = found[4]
    cell = json.loads(long['picture']) if kind == 'csv' else long['picture']
    assert cell == [*range(256), *range(256)]


def test_a_topic_with_too_many_kinds_of_messages_is_told_of(inspect, tmp_path, monkeypatch):
    monkeypatch.setattr('layered_cbf_ros.bags.inspection.export.MOST_TABLES', 3)
    parts = [words(k, '', [0.0] * k) for k in range(5)]
    bag = write(tmp_path / 'w.mcap', topic(1, '/w', 'my_msgs/msg/Words', WORDS), *parts)
    ended = inspect(bag, '--export', 'csv')
    assert (ended.code, len(list((tmp_path / 'w_csv').iterdir()))) == (2, 3)
    assert '/w: 2 rows are in no file' in ended.problem


def test_only_what_was_asked_for_is_exported(inspect, walk, tmp_path):
    options = ('--topic', '/state', '--count', '7', '--start-offset', '0.4')
    inspect(walk, '--export', 'csv', '--output', tmp_path / 'part', *options)
    (path,) = (tmp_path / 'part').iterdir()
    rows = read_rows(path)
    times = [int(row['log_time_ns']) for row in rows]
    assert (path.name, len(rows)) == ('state.csv', 7)
    assert times[0] - 1_700_000_000 * 10**9 == 400_000_000


def test_parquet_without_pyarrow_is_one_line(inspect, walk, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'pyarrow', None)
    ended = inspect(walk, '--export', 'parquet', '--output', tmp_path / 'x')
    assert (ended.code, list(tmp_path.iterdir())) == (2, [])
    assert 'pip install pyarrow' in ended.problem


@pytest.mark.parametrize(
    ('options', 'name'),
    [
        (('--plot',), 'distances.png'),
        (('--plot',), 'report.html'),
        (('--export', 'csv'), 'state.2.csv'),
    ],
)
def test_nothing_is_overwritten_without_force(inspect, walk, tmp_path, options, name):
    folder = tmp_path / 'mine'
    folder.mkdir()
    (folder / name).write_text('mine')
    (folder / 'notes.csv').write_text('mine too')
    where = [*options, folder] if options == ('--plot',) else [*options, '--output', folder]
    ended = inspect(walk, *where)
    assert (ended.code, ended.out) == (2, '')
    assert f'{folder / name} exists already' in ended.problem
    assert '--force' in ended.problem
    assert sorted(path.name for path in folder.iterdir()) == sorted((name, 'notes.csv'))
    assert inspect(walk, *where, '--force').code == 0
    assert (folder / 'notes.csv').read_text() == 'mine too'
    assert not (folder / name).exists() or (folder / name).read_bytes() != b'mine'


class Page(HTMLParser):
    """What a browser would fetch or run."""

    def __init__(self):
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.text = ''

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.sources += [value for name, value in attributes if name in ('src', 'href', 'data')]

    def handle_data(self, data):
        self.text += data


def test_the_page_holds_all_figures_and_needs_nothing_else(inspect, walk, tmp_path):
    folder = tmp_path / 'figures'
    document = json.loads(inspect(walk, '--plot', folder, '--json').out)
    pictures = sorted(folder.glob('*.png'))
    assert len(pictures) == 7
    assert sorted(document['written']) == sorted(map(str, folder.iterdir()))
    source = (folder / 'report.html').read_text()
    page = Page()
    page.feed(source)
    assert not {'script', 'link', 'iframe', 'object'} & set(page.tags)
    assert 'http' not in source
    assert 'url(' not in source
    prefix = 'data:image/png;base64,'
    assert all(value.startswith(prefix) for value in page.sources)
    embedded = {base64.b64decode(value[len(prefix) :]) for value in page.sources}
    assert embedded == {path.read_bytes() for path in pictures}
    for word in ('/simulator/clearance', 'smallest clearance', 'not passed', str(walk)):
        assert word in page.text


def test_the_page_of_a_foreign_bag_is_harmless(inspect, tmp_path):
    """What stands in a bag is shown, not obeyed."""
    kind = 'my_msgs/msg/Number'
    bag = write(
        tmp_path / 'a.mcap', topic(1, '/<script>alert(1)</script>', kind, 'int8 a\n'),
        message(1, 1, b'\0\1\0\0\5'),
    )  # fmt: skip
    ended = inspect(bag, '--plot')
    assert (ended.code, ended.err) == (0, '')
    (path,) = (tmp_path / 'a_figures').iterdir()
    page = Page()
    page.feed(path.read_text())
    assert 'script' not in page.tags
    assert 'alert(1)' in page.text


def test_both_kinds_of_tables_are_known():
    assert tuple(sorted(tables.FORMATS)) == KINDS
