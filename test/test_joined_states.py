"""The states of real robots come on a topic each, not in step: joined, nobody is shifted."""

from types import SimpleNamespace

import numpy as np

from layered_cbf_ros.bags.run.joined_states import is_robot_state, joined_states
from layered_cbf_ros.bags.run.series import Series

SCENARIO = SimpleNamespace(robots=[SimpleNamespace(name='a1_0'), SimpleNamespace(name='a1_1')])


def ramp(robot, stamps):
    """Let the one entry of a robot's state be its own stamp."""
    values = np.tile(np.array(stamps, dtype=float)[:, None, None], (1, 3, 1))
    return Series((f'{robot}/base_x',), np.array(stamps, dtype=np.int64), values)


def test_of_each_robot_the_newest_state_counts_at_the_stamps_of_the_last():
    first, last = ramp('a1_0', [10, 20, 30, 40]), ramp('a1_1', [5, 12, 25, 39, 52])
    told = {'/a1_0/state': first, '/a1_1/state': last}
    joined = joined_states(told, SCENARIO)
    assert joined.names == ('a1_0/base_x', 'a1_1/base_x')
    # by hand: at 5 the first robot was not heard yet
    assert joined.stamps_ns.tolist() == [12, 25, 39, 52]
    assert joined.values[:, 0, 0].tolist() == [10, 20, 30, 40]
    assert joined.values[:, 0, 1].tolist() == [12, 25, 39, 52]


def test_without_states_there_is_nothing_to_join():
    assert joined_states({}, SCENARIO) is None


def test_the_state_of_a_simulated_world_is_not_that_of_one_robot():
    assert is_robot_state('/a1_0/state')
    assert not is_robot_state('/state')
