"""What a recorder counts: losses by the publishers' own numbers, and which topics it takes."""

from __future__ import annotations

import random

import numpy as np
import pytest

from layered_cbf_ros.bags.recording.command_line import ros_arguments
from layered_cbf_ros.bags.recording.losses import NOTE, TopicLosses, note_of, read_losses, summary
from layered_cbf_ros.bags.recording.parameters import RecorderParameters
from layered_cbf_ros.bags.recording.progress import TopicProgress, recorded_up_to
from layered_cbf_ros.bags.recording.sequence_counter import SequenceCounter
from layered_cbf_ros.bags.recording.topic_counter import TopicCounter, counter_for
from layered_cbf_ros.bags.topic_selection import TopicSelection
from layered_cbf_ros.errors import BagError, ParameterError
from layered_cbf_ros.messages.joint_state import JointStateWriter

MS = 1_000_000


def counted(numbers: list[int], publishers: int = 1) -> tuple[int, int]:
    """Return what is counted as lost, and as missed before."""
    counter = SequenceCounter(lambda: publishers)
    for number in numbers:
        counter.receive(number)
    return counter.lost, counter.missed_before


@pytest.mark.parametrize('seed', range(20))
def test_the_loss_of_one_publisher_is_exact(seed):
    rng = random.Random(seed)
    first = rng.randrange(1, 50)
    received = [first] + [k for k in range(first + 1, 999) if rng.random() > 0.2] + [999]
    assert counted(received) == (1000 - first - len(received), first - 1)


@pytest.mark.parametrize('seed', range(20))
def test_several_publishers_that_lose_nothing_are_not_accused(seed):
    """Whatever the order in which their messages come, one stream overtaking another or not."""
    rng = random.Random(seed)
    left = {name: iter(range(1, rng.randrange(2, 200))) for name in range(rng.randrange(2, 6))}
    count, numbers = len(left), []
    while left:
        name = rng.choice(list(left))
        number = next(left[name], None)
        if number is None:
            del left[name]
        else:
            numbers.append(number)
    assert counted(numbers, count) == (0, 0)


def test_a_loss_among_several_publishers_is_counted():
    old = list(range(1000, 1100))
    new = [k for k in range(1, 101) if k not in (50, 51, 52, 77)]
    mixed = [number for pair in zip(old, new, strict=False) for number in pair]
    assert counted(mixed, 2) == (4, 999)


def test_a_publisher_that_starts_again_is_no_loss():
    assert counted([1, 2, 3, 4, 5, 1, 2, 3, 4, 5, 6, 7, 8]) == (0, 0)
    assert counted([1, 2, 3, 4, 5, 1, 2, 3, 9, 10]) == (5, 0)  # not 3: the first one is gone


def follow(lags_ms: dict[str, int], ticks: int = 300) -> dict[str, TopicCounter]:
    """Return counters of topics at 1 kHz that are each some milliseconds behind the state."""
    counters = {name: counter_for('sensor_msgs/msg/JointState') for name in lags_ms}
    for tick in range(ticks):
        for name, counter in counters.items():
            if tick >= lags_ms[name]:
                receive(counter, tick - lags_ms[name])
    return counters


def receive(counter: TopicCounter, stamp_ms: int) -> None:
    counter.receive(JointStateWriter(['a']).encode(stamp_ms * MS, *[np.ones(1)] * 3))


def test_the_simulator_waits_for_the_slowest_topic():
    """What hangs is told of as it hangs; a constant latency is none; silence is an end."""
    counters = follow({'state': 0, 'command': 1, 'late by design': 200})
    progress = {name: TopicProgress(counter) for name, counter in counters.items()}

    def told() -> int:
        return recorded_up_to(counters['state'].last_ns, progress.values())

    for each in progress.values():
        each.refresh()
    assert told() == 299 * MS
    for stamp in range(300, 400):
        receive(counters['state'], stamp)
        receive(counters['late by design'], stamp - 200)
        told()
    assert 299 * MS < told() < 320 * MS  # the newest command is of 298 ms
    for stamp in range(299, 390):
        receive(counters['command'], stamp)
    assert told() == 399 * MS
    for _ in range(1000):  # the command has ended, and a run must not hang
        receive(counters['state'], counters['state'].last_ns // MS + 1)
        told()
    receive(counters['late by design'], counters['state'].last_ns // MS - 200)
    assert told() == counters['state'].last_ns


def test_a_topic_that_stalls_at_its_start_holds_the_sender_back_at_once():
    """Publishers keep 128 messages: what nobody waits for in the first second is lost."""
    counters = {name: counter_for('sensor_msgs/msg/JointState') for name in ('state', 'command')}
    writer, values = JointStateWriter(['a']), [np.zeros(1)] * 3
    progress = [TopicProgress(counter) for counter in counters.values()]
    for stamp in range(200):
        data = writer.encode(stamp * MS, *values)
        counters['state'].receive(data)
        if stamp < 3:
            counters['command'].receive(data)
        told = recorded_up_to(stamp * MS, progress)
    assert told < 20 * MS  # the last command is of 2 ms


def test_what_a_recorder_notes_is_read_back():
    losses = {'/a': TopicLosses(10, 2, 3, 4, 5), '/b c': TopicLosses(0)}
    assert read_losses({NOTE: note_of(losses)}) == losses
    assert read_losses({}) is None
    assert read_losses({NOTE: {'/a': 'received=3 lost=1 of_a_later_version=7'}}) == {
        '/a': TopicLosses(3, 1)
    }
    for spoilt in ('', 'lost=1', 'received=many', 'received'):
        with pytest.raises(BagError, match="note 'recorder' of /a"):
            read_losses({NOTE: {'/a': spoilt}})


def test_a_loss_cannot_be_overlooked():
    losses = {'/a': TopicLosses(10, 2), '/b': TopicLosses(5, 0, 7)}
    assert summary(losses, []) == (
        '15 messages of 2 topics, 2 LOST on /a, 7 sent before the recorder was there'
    )
    assert 'nothing lost, NOT RECORDED: /c' in summary({'/b': TopicLosses(5)}, ['/c'])


@pytest.mark.parametrize(
    ('given', 'wanted'),
    [
        ({}, '/a /a/b /c'),
        ({'topics': frozenset(('/a', '/_h'))}, '/a /_h'),
        ({'regex': 'a'}, '/a /a/b'),
        ({'topics': frozenset(('/c',)), 'regex': 'b$'}, '/a/b /c'),
        ({'exclude_regex': '^/a'}, '/c'),
        ({'topics': frozenset(('/a', '/c')), 'exclude_topics': frozenset(('/a',))}, '/c'),
    ],
)
def test_leaving_out_goes_before_taking(given, wanted):
    selection = TopicSelection(**given)
    assert [t for t in ('/a', '/a/b', '/_h', '/c') if selection.wants(t)] == sorted(
        wanted.split(), key=['/a', '/a/b', '/_h', '/c'].index
    )


def test_flags_become_parameters():
    text = 'state -b 100000 --force --ros-args -r __ns:=/x -- --regex a"b\\d -d 2.5 --topics /t'
    arguments = ros_arguments(text.split())
    assert arguments[:5] == ['--ros-args', '-r', '__ns:=/x', '--', '--ros-args']
    assert set(arguments[6::2]) == {
        'topics:="state /t"',
        'regex:="a\\"b\\\\d"',
        'max_bag_size:=100000',
        'max_bag_duration:=2.5',
        'force:=true',
    }
    assert ros_arguments([]) == []


def test_help_explains_every_parameter(capsys):
    with pytest.raises(SystemExit, match='0'):
        ros_arguments(['--help'])
    said = capsys.readouterr().out
    for name in RecorderParameters.__dataclass_fields__:
        assert f'  {name}: ' in said


def test_parameters_that_contradict_themselves_are_named():
    with pytest.raises(ParameterError, match=r"exclude_regex is '\(': .*regular expression"):
        RecorderParameters(exclude_regex='(')
    with pytest.raises(ParameterError, match='max_bag_size is 5; give 0 or at least'):
        RecorderParameters(max_bag_size=5)
