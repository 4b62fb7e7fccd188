"""What a replay is asked for: topics, times, quality of service; and what it refuses."""

from __future__ import annotations

import pytest
import yaml
from test_bags import string_cdr

from layered_cbf_ros.bags.playback.command_line import parse
from layered_cbf_ros.bags.playback.offered_qos import OfferedQos, qos_to_offer
from layered_cbf_ros.bags.playback.replay_plan import (
    latched_before,
    plan_replay,
    records_of_round,
)
from layered_cbf_ros.bags.playback.selection import Selection, parse_remap, select
from layered_cbf_ros.bags.storage.metadata import qos_yaml
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.bags.storage.topic import Topic
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError

MS, S = 1_000_000, 1_000_000_000
STRING = 'std_msgs/msg/String'
SAID = Topic('/said', STRING, '')

TOPICS = {
    name: Topic(name, kind, '')
    for name, kind in (
        ('/state', 'sensor_msgs/msg/JointState'),
        ('/a1_0/imu', 'sensor_msgs/msg/Imu'),
        ('/a1_1/imu', 'sensor_msgs/msg/Imu'),
        ('/clock', 'rosgraph_msgs/msg/Clock'),
    )
}


@pytest.mark.parametrize(
    ('wanted', 'expected'),
    [
        (Selection(), set(TOPICS)),
        (Selection(topics=('/state',)), {'/state'}),
        (Selection(exclude=('/state',)), set(TOPICS) - {'/state'}),
        (Selection(regex='/a1_./imu'), {'/a1_0/imu', '/a1_1/imu'}),
        (Selection(topics=('/clock',), regex='a1_0'), {'/clock', '/a1_0/imu'}),
        (Selection(exclude_regex='^/a1'), {'/state', '/clock'}),
        (Selection(regex='imu', exclude=('/a1_1/imu',)), {'/a1_0/imu'}),
    ],
)
def test_topics_are_chosen_by_name_and_regular_expression(wanted, expected):
    assert set(select(TOPICS, wanted)) == expected


def test_remapped_topics_get_their_new_names_and_no_other_does():
    remap = parse_remap(['state:=/old/state', '/clock:=old_clock'])
    names = select(TOPICS, Selection(remap=remap))
    assert names['/state'] == '/old/state'
    assert names['/clock'] == '/old_clock'
    assert names['/a1_0/imu'] == '/a1_0/imu'


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--rate', '0'], "--rate: '0'"),
        (['-r', '-2'], "--rate: '-2'"),
        (['-r', 'nan'], "--rate: 'nan'"),
        (['--clock', '0'], "--clock: '0'"),
        (['--start-offset', '-1'], "--start-offset: '-1'"),
        (['--playback-duration', 'all'], "--playback-duration: 'all'"),
        (['-d', '-0.1'], "--delay: '-0.1'"),
        (['-e', '(('], "--regex: '(('"),
        (['-m', '/state=/x'], "'/state=/x'"),
        (['-m', '/state:='], "'/state:='"),
        (['-m', '/a:=/b', 'a:=/c'], "'a:=/c'"),
        (['--no-such-flag'], '--no-such-flag'),
        (['--inputs-of', 'coordinator', '-l'], '--loop'),
        (['--inputs-of', 'coordinator', '--topics', '/a'], '--topics'),
        (['--start-offset', '9'], '--start-offset 9 s'),
        (['--topics', '/stat'], "'/stat'"),
        (['--exclude-topics', '/stat'], "'/stat'"),
        (['-m', '/stat:=/x'], "'/stat'"),
        (['-e', 'nothing'], 'no topic'),
        (['-m', '/said:=/clock'], "'/clock'"),
        (['--clock'], '--exclude-topics /clock'),
        (['--inputs-of', 'coordinator'], '/scenario'),
    ],
)
def test_a_wrong_flag_is_one_line_that_names_it_and_its_value(tmp_path, arguments, words):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write(writer.add_topic('/said', STRING), string_cdr('a'), 0, 0)
        writer.write(writer.add_topic('/clock', 'rosgraph_msgs/msg/Clock'), bytes(12), 2 * S, 0)
    bag = open_bag(tmp_path / 'bag')
    with pytest.raises(BagError) as error:
        plan_replay(bag, parse([str(tmp_path / 'bag'), *arguments]))
    assert words in str(error.value)
    assert '\n' not in str(error.value)


def write(folder, *entries, qos=None):
    """Write strings: (topic, log time, text)."""
    topics = {}
    with BagWriter(folder) as bag:
        for topic, log_ns, word in entries:
            if topic not in topics:
                topics[topic] = bag.add_topic(topic, STRING, (qos or {}).get(topic))
            bag.write(topics[topic], string_cdr(word), log_ns, log_ns)
    return open_bag(folder)


def words(records):
    return [record.data[8:-1].decode() for record in records]


def test_offset_and_duration_are_bag_time_from_the_begin_of_the_bag(tmp_path):
    entries = [('/said', 7 * S + k * 100 * MS, str(k)) for k in range(10)]
    bag = write(tmp_path / 'bag', ('/other', 6 * S, 'x'), *entries)
    options = ['--start-offset', '1.2', '--playback-duration', '0.3', '--topics', '/said']
    plan = plan_replay(bag, parse([str(bag.path), *options]))
    assert words(records_of_round(bag, plan, {'/said'})) == ['2', '3', '4', '5']
    assert (plan.start_ns, plan.end_ns) == (7200 * MS, 7500 * MS)


def test_latched_words_from_before_the_offset_are_not_lost(tmp_path):
    said = [('/latched', k * S, f'l{k}') for k in (1, 2, 3, 6)]
    latched = qos_yaml('reliable', 'transient_local', 2)
    bag = write(tmp_path / 'bag', *said, ('/said', 9 * S, 'x'), qos={'/latched': latched})
    plan = plan_replay(bag, parse([str(bag.path), '--start-offset', '4']))
    assert words(latched_before(bag, plan, {'/latched': 2})) == ['l2', 'l3']
    whole = plan_replay(bag, parse([str(bag.path)]))
    assert latched_before(bag, whole, {'/latched': 2}) == []


def test_a_log_clock_that_jumped_back_is_told(tmp_path):
    bag = write(tmp_path / 'bag', *[('/said', t * S, str(t)) for t in (10, 11, 7, 8)])
    plan = plan_replay(bag, parse([str(bag.path)]))
    (note,) = plan.notes
    assert '/said' in note
    assert '4.000 s' in note
    assert words(records_of_round(bag, plan, {'/said'})) == ['7', '8', '10', '11']


def profile(**changes):
    (entry,) = yaml.safe_load(qos_yaml())
    return {**entry, **changes}


def offered(*profiles):
    return qos_to_offer(Topic('/said', STRING, '', qos=yaml.safe_dump(list(profiles))))


def test_quality_of_service_is_the_recorded_one():
    deadline = {'sec': 1, 'nsec': 5}
    found = offered(
        profile(reliability='best_effort', depth=3, deadline=deadline, liveliness='manual_by_topic')
    )
    assert found == OfferedQos('best_effort', 'volatile', 3, S + 5, 0, 'manual_by_topic')
    assert offered(profile(history='keep_all')).depth == 0
    assert offered(profile(history='unknown', depth=0)).depth == 10
    assert offered(profile(reliability=2, durability=1, history=1)) == OfferedQos(
        'best_effort', 'transient_local'
    )
    assert qos_to_offer(SAID) == OfferedQos()


def test_publishers_that_differed_are_replaced_by_the_default_and_alike_ones_by_one():
    assert offered(profile(), profile(durability='transient_local')) == OfferedQos()
    alike = [profile(reliability='best_effort', depth=depth) for depth in (2, 20, 5)]
    assert offered(*alike) == OfferedQos('best_effort', 'volatile', 20)
    latched = [profile(durability='transient_local', depth=1)] * 12
    assert offered(*latched).depth == 12


def test_spoilt_profiles_are_named_with_a_remedy():
    with pytest.raises(BagError, match='--exclude-topics /said'):
        qos_to_offer(Topic('/said', STRING, '', qos='- [1, 2'))
