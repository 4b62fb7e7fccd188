"""The paper's two simulation experiments, whole, through every process of the graph.

Figures are of simulated time and repeat to the bit on one machine; limits leave
room for another processor, which may add up in another order.
"""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from live_run import LiveRun
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

pytestmark = pytest.mark.lockstep


@pytest.fixture(scope='module', params=['one_agent_three_obstacles', 'four_agents'])
def run(request, tmp_path_factory):
    """A finished run of the scenario, with a limit on its wall time of its own."""
    live = LiveRun(request.param, tmp_path_factory.mktemp('paper') / 'run')
    live.end()
    return live


def test_the_robot_reaches_its_goal_and_nobody_is_touched(run):
    summary = run.summary()
    assert summary['exit_code'] == 0, run.said
    assert summary['goal_reached_s'] < 45.0
    assert summary['min_clearance_m'] >= 0.55
    assert (summary['falls'], summary['contacts']) == (0, 0)


def test_every_robot_follows_its_plan_within_millimetres(run):
    summary = run.summary()
    assert summary['max_plan_error_m'] < 0.010
    assert summary['max_roll_deg'] < 1.0
    assert summary['max_pitch_deg'] < 1.0
    assert summary['max_torque_nm'] < 20.0


def test_no_solver_fails_and_nothing_is_missed(run):
    summary = run.summary()
    for figure in ('solver_failures', 'slack_events', 'deadline_misses', 'rejected'):
        assert summary[figure] == 0, figure
    assert summary['truncated'] is False


def test_the_barriers_of_every_pair_are_in_the_bag_and_above_zero(run):
    """Read by an independent reader; psi0 is the paper's h, psi1 its second set."""
    pairs: set[str] = set()
    with AnyReader([Path(run.summary()['bag'])], default_typestore=JAZZY) as reader:
        topic = [c for c in reader.connections if c.topic == '/coordinator/barriers']
        for connection, _, data in reader.messages(topic):
            message = reader.deserialize(data, connection.msgtype)
            pairs |= set(message.joint_names)
            for point in message.points:
                assert point.positions.min() > 0.0
                assert point.velocities.min() > 0.0
    robots = 1 if any('obstacle' in pair for pair in pairs) else 4
    assert len(pairs) == {1: 3 + 2, 4: 6 + 8}[robots]  # the paper's sizes of A


def test_the_figures_of_the_run_are_drawn(run):
    names = {path.stem for path in (run.output / 'figures').glob('*.png')}
    assert names >= {'trajectories', 'distances', 'barriers'}


JAZZY = get_typestore(Stores.ROS2_JAZZY)
