"""A run as a user starts it: it ends well, and whatever breaks it is named."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from live_run import LiveRun, is_alive, wait_until_gone

from layered_cbf_ros.bags.run.verdict import judge
from layered_cbf_ros.supervision import shared_memory

pytestmark = pytest.mark.system

WBC, MPC = '/a1_0/whole_body_controller', '/a1_0/ground_force_mpc'
STAND = """
description: One A1 stands.
duration: {duration}
robots:
  - {{name: a1_0, position: [0.0, 0.0], gait: stand}}
parameters:
  whole_body_controller: {{patience: 3.0}}
  simulator: {{patience: 4.0}}
"""


@pytest.fixture
def start(tmp_path):
    runs = []

    def start(duration):
        scenario = tmp_path / 'scenario.yaml'
        scenario.write_text(STAND.format(duration=duration))
        runs.append(LiveRun(scenario, tmp_path / f'run_{len(runs)}'))
        return runs[-1]

    yield start
    for run in runs:
        run.process.kill()
        run.process.wait()
        run.process.stdout.close()
        wait_until_gone(run.children.values())


def segments_of(run: LiveRun) -> frozenset[Path]:
    held = [shared_memory.held_by(pid) for pid in (run.process.pid, *run.children.values())]
    return frozenset().union(*held)


def test_a_good_run_ends_with_code_zero_a_verdict_and_nothing_left_behind(start):
    run = start(duration=2.0)
    assert run.end() == 0, run.said
    assert 'PASSED' in run.said
    summary = run.summary()
    assert (summary['outcome'], summary['passed'], summary['exit_code']) == ('finished', True, 0)
    assert list((run.output / 'figures').glob('*.png'))


def test_a_killed_controller_is_named_and_its_shared_memory_is_removed(start):
    run = start(duration=60.0)
    run.until_running()
    held = segments_of(run)
    os.kill(run.children[WBC], signal.SIGKILL)
    assert run.end() == 1
    assert run.summary()['missing'] == [WBC]
    assert f'{WBC} was killed by SIGKILL' in run.said
    assert not any(is_alive(pid) for pid in run.children.values())
    assert held
    assert not [path for path in held if path.exists()]


def test_a_hung_controller_is_told_from_those_who_wait_for_it(start):
    run = start(duration=60.0)
    run.until_running()
    os.kill(run.children[MPC], signal.SIGSTOP)
    assert run.end() == 1
    assert f'{WBC}: MISSING {MPC}' in run.said
    assert run.summary()['missing'] == [MPC]
    assert not is_alive(run.children[MPC])


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_stopped_closes_its_bag(start, number):
    run = start(duration=60.0)
    run.until_running()
    run.process.send_signal(number)
    assert run.end() == 130
    assert run.summary()['outcome'] == 'stopped'
    assert run.summary()['truncated'] is False


def test_a_killed_supervisor_leaves_no_orphan_a_whole_bag_and_a_note_what_to_tidy_up(start):
    run = start(duration=60.0)
    run.until_running()
    held = segments_of(run)
    run.process.kill()
    wait_until_gone(run.children.values())
    assert not judge(run.output).truncated
    assert [path for path in held if path.exists()]  # nobody was left to remove them
    assert start(duration=0.5).end() == 0
    assert not [path for path in held if path.exists()]
