"""Replay without ROS: deadlines, topics, keys, progress, and never ahead of a fed node."""

from __future__ import annotations

import io
import math
import pty
import struct
import termios

import numpy as np
import pytest

from layered_cbf_ros.bags.playback.fed_node import FedNode, Output
from layered_cbf_ros.bags.playback.following import PATIENCE_NS, Following
from layered_cbf_ros.bags.playback.keys import Key, KeyDecoder
from layered_cbf_ros.bags.playback.player import Chore, Clock, Player
from layered_cbf_ros.bags.playback.progress import Progress
from layered_cbf_ros.bags.playback.read_ahead import BATCHES, ReadAhead
from layered_cbf_ros.bags.playback.schedule import Schedule
from layered_cbf_ros.bags.playback.terminal import Keyboard
from layered_cbf_ros.bags.playback.timing_errors import TimingErrors
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError, GraphError

MS, S = 1_000_000, 1_000_000_000
STRING = 'std_msgs/msg/String'
SAID = Topic('/said', STRING, '')


class FakeClock:
    """Time passes only in sleep, and as much as a slow machine loses in between."""

    def __init__(self) -> None:
        self.now = 5 * S
        self.lost_ns = 0
        self.clock = Clock(self.read, self.sleep)

    def read(self) -> int:
        return self.now

    def sleep(self, duration: float) -> None:
        self.now += round(duration * 1e9) + self.lost_ns


class Stage:
    """A player, what it sent and when."""

    def __init__(self, rate: float = 1.0, paused: bool = False, may_send=None) -> None:
        self.time = FakeClock()
        self.sent: list[tuple[int, int]] = []
        schedule = Schedule(100 * S, self.time.now, rate, paused)
        self.player = Player(schedule, self._publish, self.time.clock, may_send)

    def _publish(self, record: Record) -> None:
        self.sent.append((record.log_time_ns - 100 * S, self.time.now - 5 * S))

    def play(self, *log_ns: int) -> list[tuple[int, int]]:
        self.player.play(Record(SAID, 100 * S + t, 0, b'') for t in log_ns)
        return self.sent

    def at(self, when_ns: int, act) -> None:
        """Do something once, when the time has come."""
        chore = Chore(10**18, lambda _: act(), 5 * S + when_ns)
        self.player.chores.append(chore)


@pytest.mark.parametrize(('rate', 'factor'), [(1.0, 1), (2.0, 2), (0.5, 0.5)])
def test_a_rate_shortens_bag_time_on_the_schedule(rate, factor):
    sent = Stage(rate).play(0, 10 * MS, 500 * MS, 3 * S)
    assert [due for _, due in sent] == [round(log / factor) for log, _ in sent]


def test_a_slow_machine_does_not_shift_the_schedule():
    """Each deadline is absolute: delays of 0.3 ms a message don't add up."""
    stage = Stage()
    stage.time.lost_ns = 300_000
    sent = stage.play(*range(0, 1000 * MS, MS))
    late = [at - log for log, at in sent]
    assert min(late) >= 0
    assert max(late) <= 600_000
    assert stage.player.errors.max_ns == max(late)
    assert stage.player.errors.count == 1000


def test_a_pause_shifts_all_that_comes_by_its_length():
    stage = Stage()
    stage.at(1 * S, lambda: stage.player.press(Key.PAUSE))
    stage.at(4 * S, lambda: stage.player.press(Key.PAUSE))
    sent = stage.play(0, 500 * MS, 2 * S, 3 * S)
    assert [at for _, at in sent] == [0, 500 * MS, 5 * S, 6 * S]


def test_rate_keys_change_bag_time_by_a_tenth_from_then_on():
    """After 1 s at rate 1, what is left takes 1/1.1 of its time; then 1/(1.1 * 0.9)."""
    stage = Stage()
    stage.at(1 * S, lambda: stage.player.press(Key.FASTER))
    stage.at(2 * S, lambda: stage.player.press(Key.SLOWER))
    (_, first), (_, second) = stage.play(1 * S + 550 * MS, 3 * S)
    assert first == pytest.approx(1 * S + 500 * MS, abs=2)
    assert second == pytest.approx(2 * S + (3.0 - 2.1) / 0.99 * 1e9, abs=4)


def test_each_step_sends_one_message_while_paused_and_brings_bag_time_there():
    stage = Stage(paused=True)
    for at in (1, 2):
        stage.at(at * S, lambda: stage.player.press(Key.STEP))
    stage.at(3 * S, lambda: stage.player.press(Key.PAUSE))
    sent = stage.play(0, 700 * MS, 900 * MS)
    assert [at for _, at in sent] == [1 * S, 2 * S, 3 * S + 200 * MS]
    assert stage.player.errors.count == 1


def test_quit_ends_it_before_the_next_message():
    stage = Stage()
    stage.at(1 * S, lambda: stage.player.press(Key.QUIT))
    assert [log for log, _ in stage.play(0, 2 * S)] == [0]
    assert stage.player.stopped


def test_bag_time_stands_still_during_the_delay_before_a_round():
    stage, heard = Stage(), []
    schedule = stage.player.schedule
    clock = Chore(25 * MS, lambda now: heard.append(schedule.bag_time_ns(now) - 100 * S))
    stage.player.chores.append(clock)
    stage.player.rest(1 * S)
    assert set(heard) == {0}
    assert len(heard) >= 40
    assert stage.play(0, 100 * MS) == [(0, 1 * S), (100 * MS, 1100 * MS)]
    assert heard == sorted(heard)
    assert heard[-1] <= 100 * MS


def test_chores_keep_their_rhythm_and_leave_out_missed_turns():
    turns = []
    chore = Chore(10, turns.append)
    for now in (100, 105, 110, 119, 121, 155, 160):
        chore.do_if_due(now)
    assert turns == [100, 110, 121, 155, 160]


def test_percentiles_are_those_of_numpy_within_a_sixteenth():
    errors = np.random.default_rng(3).lognormal(11.0, 2.0, 20_000).astype(int)
    found = TimingErrors()
    for error in errors:
        found.add(int(error))
    assert found.mean_ns == pytest.approx(errors.mean())
    assert (found.max_ns, found.late) == (errors.max(), (errors > MS).sum())
    for share in (0.5, 0.99, 1.0):
        exact = np.percentile(errors, 100 * share, method='inverted_cdf')
        assert exact <= found.percentile_ns(share) <= exact * (1 + 1 / 16) + 1


@pytest.mark.parametrize(
    ('data', 'keys'),
    [
        (b' ', [Key.PAUSE]),
        (b'\x1b[C', [Key.STEP]),
        (b'\x1bOC\x1b[A\x1b[B', [Key.STEP, Key.FASTER, Key.SLOWER]),
        (b'xyz\r', []),
        (b'\x1b[1;5C \x1b[3~', [Key.PAUSE]),  # Ctrl with an arrow, and Delete
        (b'\x1bq', [Key.QUIT]),
    ],
)
@pytest.mark.parametrize('apart', [False, True])
def test_keys_are_told_by_their_bytes_even_one_by_one(data, keys, apart):
    decoder = KeyDecoder()
    parts = [bytes([byte]) for byte in data] if apart else [data]
    assert [key for part in parts for key in decoder.feed(part)] == keys


def test_a_terminal_is_as_before_whatever_happens_while_keys_are_read():
    outer, inner = pty.openpty()
    with open(inner, 'rb', buffering=0) as stream, open(outer, 'wb', buffering=0) as typing:
        before = termios.tcgetattr(inner)
        found = []

        def read_until_it_fails() -> None:
            with Keyboard(stream) as keyboard:
                assert not termios.tcgetattr(inner)[3] & (termios.ICANON | termios.ECHO)
                typing.write(b' \x1b[C')
                while len(found) < 2:
                    found.extend(keyboard.pressed())
                raise ValueError('midway')

        with pytest.raises(ValueError, match='midway'):
            read_until_it_fails()
        assert found == [Key.PAUSE, Key.STEP]
        assert termios.tcgetattr(inner) == before


def test_progress_is_one_line_on_a_terminal_and_lines_in_a_log():
    for terminal in (True, False):
        stream = io.StringIO()
        progress = Progress(stream, terminal, terminal, 10 * S)
        for bag_ns in (0, 5 * S, 10 * S):
            progress.show(bag_ns, 1.0, 'playing')
        progress.end()
        text = stream.getvalue()
        assert text.count('\n') == (1 if terminal else 3)
        assert text.count('\r') == (3 if terminal else 0)
        assert f'[{"#" * 15}{"-" * 15}] 5.0 of 10.0 s' in text
        assert f'[{"#" * 30}] 10.0 of 10.0 s' in text


def records(count: int, size: int = 4):
    return (Record(SAID, k, k, bytes(size)) for k in range(count))


def test_what_is_read_ahead_comes_in_order_and_with_its_error():
    def source():
        yield from records(10_000)
        raise BagError('spoilt')

    ahead, found = ReadAhead(source()), []
    with pytest.raises(BagError, match='spoilt'):
        found.extend(ahead)
    assert [record.log_time_ns for record in found] == list(range(10_000))
    assert list(ReadAhead(records(0))) == []


def test_large_messages_do_not_fill_the_memory():
    """Of images of 2 MiB no more are read ahead than there are places for, one each."""
    taken = []

    def source():
        for record in records(1000, 2 << 20):
            taken.append(record.log_time_ns)
            yield record

    ahead = ReadAhead(source())
    for k, _ in zip(range(100), ahead, strict=False):
        assert len(taken) <= k + 1 + BATCHES + 2  # one is on its way in, one out
    ahead.close()


def stamped(stamp_ns: int) -> bytes:
    return b'\0\1\0\0' + struct.pack('<iI', *divmod(stamp_ns, S)) + bytes(8)


NODE = FedNode('/node', ('/state', '/plan'), (), '/state', (Output('/done', STRING, 1),), 5)
AHEAD = 14  # two answers of five ticks each, and four on the way


def record(topic: str, stamp_ns: int) -> Record:
    return Record(Topic(topic, STRING, ''), stamp_ns, stamp_ns, stamped(stamp_ns))


def test_a_fed_node_is_never_more_than_a_few_ticks_behind():
    answers: list[bytes] = []
    following = Following(NODE, lambda: [answers.pop(0) for _ in range(len(answers))])
    sent = 0
    for tick in range(1000):
        if not following.may_send(record('/state', tick * MS), tick):
            break
        sent += 1
    assert sent == AHEAD
    assert following.may_send(record('/plan', 0), 0)  # only states are counted
    answers.append(stamped(9 * MS))  # ten of them are done
    passed = [following.may_send(record('/state', (AHEAD + k) * MS), 0) for k in range(12)]
    assert passed == [True] * 10 + [False] * 2
    assert following.answers == 1


def test_a_fed_node_that_is_silent_for_long_ends_the_replay_with_its_name():
    following = Following(NODE, list)
    for tick in range(AHEAD):
        assert following.may_send(record('/state', tick * MS), 0)
    late = record('/state', S)
    assert not following.may_send(late, 0)
    assert not following.may_send(late, PATIENCE_NS)
    with pytest.raises(GraphError, match=r'/node has not answered /state of 0\.000 s'):
        following.may_send(late, PATIENCE_NS + 1)


def test_time_held_back_by_a_node_is_no_delay_of_the_replay():
    """A node that is busy for 1 s shifts the schedule by that, and no error is counted."""
    stage = Stage(may_send=lambda record, now: now > 6 * S or record.log_time_ns == 100 * S)
    (_, first), (_, second), (_, third) = stage.play(0, 10 * MS, 30 * MS)
    assert (first, math.isclose(second, S, rel_tol=1e-3)) == (0, True)
    assert third - second == 20 * MS
    assert stage.player.errors.max_ns < MS
    assert stage.player.held_ns == pytest.approx(S - 10 * MS, abs=MS)
