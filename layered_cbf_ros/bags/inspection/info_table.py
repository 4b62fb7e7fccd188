"""What a bag holds, as text for a terminal of 100 columns."""

from __future__ import annotations

from datetime import datetime
from itertools import groupby

from layered_cbf_ros.bags.inspection.bag_info import BagInfo, TopicInfo
from layered_cbf_ros.bags.recording.losses import REFUSED_NOTE, read_losses, summary
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S

LEAST_WIDTH = 24
MOST_FILES = 5
HEADINGS = ('count', 'Hz (log)', 'Hz (stamp)', 'gap [s]')
UNITS = ('B', 'KiB', 'MiB', 'GiB', 'TiB')


def info_lines(info: BagInfo) -> list[str]:
    """Return what a bag holds: first the whole, then a line a topic, by types."""
    whole = [f'{name:<10}{value}' for name, value in overview(info)]
    return [*whole, '', *_topic_lines(info.topics)]


def overview(info: BagInfo) -> list[tuple[str, str]]:
    """Return name and value of what is to be told of a whole bag."""
    names = [f'{file.name} ({size_text(file.size)})' for file in info.files[:MOST_FILES]]
    more = len(info.files) - MOST_FILES
    entries = [
        ('bag', info.path),
        ('files', ', '.join(names) + (f' and {more} more' if more > 0 else '')),
        ('storage', f'{info.storage}, {size_text(info.size)}'),
    ]
    if info.messages:
        entries += [
            ('start', local_date(info.start_ns)),
            ('end', local_date(info.end_ns)),
            ('duration', f'{info.duration_s:.3f} s'),
        ]
    entries.append(('messages', f'{info.messages} on {len(info.topics)} topics'))
    return entries + [('recorder', told) for told in [_told_by_recorder(info)] if told]


def topic_cells(topic: TopicInfo) -> tuple[str, ...]:
    """Return count, both rates and the longest gap, as in HEADINGS; '-' without a meaning."""
    return (
        str(topic.count),
        _number(topic.log_rate_hz, 1),
        _number(topic.stamp_rate_hz, 1),
        _number(topic.longest_gap_s, 3),
    )


def by_type(topics: tuple[TopicInfo, ...]) -> list[tuple[str, list[TopicInfo]]]:
    """Return the topics of each type, both in the order of names."""
    ordered = sorted(topics, key=lambda topic: (topic.type_name, topic.name))
    return [(kind, list(group)) for kind, group in groupby(ordered, lambda t: t.type_name)]


def size_text(size: int) -> str:
    """Return a size [byte] with a unit that makes it short."""
    value, unit = float(size), 0
    while value >= 1024.0 and unit < len(UNITS) - 1:
        value, unit = value / 1024.0, unit + 1
    return f'{value:.1f} {UNITS[unit]}' if unit else f'{size} B'


def local_date(time_ns: int) -> str:
    """Return a time since the epoch [ns] as a date of this place."""
    seconds, rest = divmod(time_ns, NS_PER_S)
    date = datetime.fromtimestamp(seconds).astimezone()
    return f'{date:%a %Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} {date:%Z}'


def _told_by_recorder(info: BagInfo) -> str:
    """Return what the recorder says of losses; '' if it says nothing that can be read."""
    try:
        losses = read_losses(info.notes)
    except BagError:
        return ''
    return '' if losses is None else summary(losses, tuple(info.notes.get(REFUSED_NOTE, ())))


def _topic_lines(topics: tuple[TopicInfo, ...]) -> list[str]:
    if not topics:
        return ['no topics']
    width = max(LEAST_WIDTH, *(len(topic.name) + 2 for topic in topics))
    lines = [_row('topic', HEADINGS, 'offered', width)]
    lines.append('-' * len(lines[0]))
    for kind, group in by_type(topics):
        lines.append(kind or 'unknown type')
        lines += [_row(f'  {t.name}', topic_cells(t), t.offered, width) for t in group]
    return lines


def _row(name: str, cells: tuple[str, ...], offered: str, width: int) -> str:
    widths = [max(len(heading), 7) for heading in HEADINGS]
    numbers = '  '.join(map(str.rjust, cells, widths))
    return f'{name:<{width}}  {numbers}  {offered}'.rstrip()


def _number(value: float | None, digits: int) -> str:
    return '-' if value is None else f'{value:.{digits}f}'
