"""The whole graph repeats to the bit, keeps to itself, and outlives its coordinator."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from live_node import DOMAIN
from live_run import ENVIRONMENT, LIMIT_S, LiveRun

from layered_cbf_ros.bags.run.run_record import load_run
from layered_cbf_ros.bags.run.verdict import judge
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.run_nodes import RECORDER
from layered_cbf_ros.run_nodes import SIMULATOR as PLANT
from layered_cbf_ros.scenario_file import load_scenario, with_overrides
from layered_cbf_ros.supervision.process_plan import process_plan
from layered_cbf_ros.supervision.run_folder import make_run_folder

pytestmark = pytest.mark.system


def summary_of(scenario: str, output: Path, *options: str) -> dict:
    """Run a scenario to its end; return its summary."""
    run = LiveRun(scenario, output, *options)
    run.end()
    return run.summary()


def spin() -> None:
    """Load one core."""
    while True:
        pass


@pytest.fixture
def both_cores_loaded():
    busy = [multiprocessing.Process(target=spin, daemon=True) for _ in range(2)]
    for process in busy:
        process.start()
    yield
    for process in busy:
        process.kill()
        process.join()


@pytest.fixture(scope='module')
def reference(tmp_path_factory):
    """One second of four robots, undisturbed."""
    output = tmp_path_factory.mktemp('reference') / 'run'
    return summary_of('four_agents', output, '--duration', '1.0')


def test_every_state_of_a_run_is_in_its_bag(reference):
    records = BagReader(Path(reference['bag'])).records(['/state'])
    assert sum(1 for _ in records) == 1001
    assert reference['rejected'] == 0
    assert reference['deadline_misses'] == 0


def test_the_same_seed_gives_the_same_bits_on_a_loaded_machine(
    reference, tmp_path, both_cores_loaded
):
    again = summary_of('four_agents', tmp_path / 'run', '--duration', '1.0')
    assert again['trajectory_sha256'] == reference['trajectory_sha256']


def run_by_hand(scenario: str, output: Path, before: str = '', backwards: bool = False) -> str:
    """Start the very processes of the supervisor, without it; return the run's hash.

    Args:
        scenario: Name of the scenario; one second of it is run.
        output: Folder of the run.
        before: Python code that each node but the recorder executes first.
        backwards: Start the nodes in the opposite order.
    """
    world = with_overrides(load_scenario(scenario), duration=1.0)
    folder = make_run_folder(world, 'now', output, True)
    plan = process_plan(world, folder.parameters, True)
    processes = {}
    for spec in reversed(plan) if backwards else plan:
        program = f'from layered_cbf_ros.nodes.{spec.executable} import main; main()'
        code = program if spec.name == RECORDER else f'{before}\n{program}'
        command = [sys.executable, '-c', code, *spec.arguments]
        processes[spec.name] = subprocess.Popen(command, env=ENVIRONMENT)
    try:
        assert processes[PLANT].wait(LIMIT_S) == 0
        for name in (*(name for name in processes if name not in (PLANT, RECORDER)), RECORDER):
            processes[name].send_signal(signal.SIGINT)
            assert processes[name].wait(30.0) == 0
    finally:
        for process in processes.values():
            process.kill()
    return judge(folder.path / 'bag').trajectory_sha256


def test_the_order_in_which_nodes_start_does_not_matter(reference, tmp_path):
    again = run_by_hand('four_agents', tmp_path / 'run', backwards=True)
    assert again == reference['trajectory_sha256']


def test_lost_messages_are_sent_again_and_change_nothing(tmp_path):
    """Each node loses one message in 500, of every topic, at random."""
    lossy = """
import random
from layered_cbf_ros.nodes.transport import Reader
take = Reader.take
def take_or_lose(self):
    data = take(self)
    return None if data is not None and random.random() < 0.002 else data
Reader.take = take_or_lose
"""
    name = 'one_agent_three_obstacles'
    undisturbed = run_by_hand(name, tmp_path / 'undisturbed')
    assert run_by_hand(name, tmp_path / 'lossy', before=lossy) == undisturbed


def test_another_seed_gives_another_run(tmp_path):
    """The hash can tell runs apart: detections are noisy, and their noise goes by seed."""
    options = ('--duration', '0.6', '--seed')
    first, second = (
        summary_of('one_agent_three_obstacles', tmp_path / seed, *options, seed)
        for seed in ('1', '2')
    )
    assert first['trajectory_sha256'] != second['trajectory_sha256']


def test_two_runs_do_not_share_a_domain(tmp_path):
    first = LiveRun('two_agents_swap', tmp_path / 'first')
    first.until_running()
    second = LiveRun('stand', tmp_path / 'second')
    assert second.end() != 0
    errors = [line for line in second.said.splitlines() if line.startswith('ERROR')]
    assert len(errors) == 1
    assert str(DOMAIN) in errors[0]
    first.process.send_signal(signal.SIGINT)
    first.end()
    assert first.summary()['truncated'] is False


def seconds_in(bag: Path) -> float:
    """Return the stamp of the newest state in a bag that is being written [s]."""
    try:
        stamps = [stamp_of(record.data) for record in BagReader(bag).records(['/state'])]
    except BagError:
        return 0.0
    return max(stamps, default=0) / NS_PER_S


PATIENT = """
description: Real time on a machine that may be slow - half the rates, and more patience.
duration: 14.0
time: real_time
rates: {state: 500, plan: 250}
robots:
  - {name: a1_0, position: [0.0, 0.0], desired: {velocity: [{at: 2.0, x: 0.4}]}}
parameters:
  simulator: {command_age_limit: 0.1}
  whole_body_controller: {age_limit: 0.1}
  ground_force_mpc: {age_limit: 0.1}
"""


def test_in_real_time_a_robot_outlives_its_coordinator(tmp_path):
    """Killed while walking: the robot brakes, and a new coordinator walks it on."""
    scenario = tmp_path / 'patient.yaml'
    scenario.write_text(PATIENT)
    run = LiveRun(scenario, tmp_path / 'run')
    run.until_running()
    while seconds_in(run.output / 'bag') < 5.0:
        assert run.process.poll() is None
        time.sleep(0.2)
    os.kill(run.children['/coordinator'], signal.SIGKILL)
    run.end()
    assert '/coordinator: was killed by SIGKILL; started again' in run.said
    summary = run.summary()
    assert summary['outcome'] == 'finished'
    assert (summary['falls'], summary['contacts']) == (0, 0)
    motion = load_run(run.output / 'bag').motions['a1_0']
    speed = np.hypot(*motion.velocities[:, :2].T)
    walking = np.flatnonzero(speed > 0.2)
    stopped = walking[0] + np.flatnonzero(speed[walking[0] :] < 0.05)
    assert len(stopped), 'it never stopped'
    assert speed[stopped[0] :].max() > 0.2, 'it never walked on'
