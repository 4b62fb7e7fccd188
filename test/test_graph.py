"""The whole graph repeats to the bit, keeps to itself, and outlives its coordinator."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from live_node import DOMAIN
from live_run import ENVIRONMENT, LIMIT_S, LiveRun

from layered_cbf_ros.bags.reader import BagReader
from layered_cbf_ros.bags.verdict import judge
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


def test_the_order_in_which_nodes_start_does_not_matter(reference, tmp_path):
    """The very processes of the supervisor, started by hand the other way round."""
    scenario = with_overrides(load_scenario('four_agents'), duration=1.0)
    folder = make_run_folder(scenario, 'now', tmp_path / 'run', True)
    processes = []
    for spec in reversed(process_plan(scenario, folder.parameters, True)):
        program = f'from layered_cbf_ros.nodes.{spec.executable} import main; main()'
        command = [sys.executable, '-c', program, *spec.arguments]
        processes.append(subprocess.Popen(command, env=ENVIRONMENT))
    plant, *others = processes
    try:
        assert plant.wait(LIMIT_S) == 0
        for process in others:
            process.send_signal(signal.SIGINT)
            assert process.wait(30.0) == 0
    finally:
        for process in processes:
            process.kill()
    assert judge(folder.path / 'bag').trajectory_sha256 == reference['trajectory_sha256']


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


def test_in_real_time_a_robot_outlives_its_coordinator(tmp_path):
    """Killed while walking: the robot brakes and stands, and a new one takes over."""
    run = LiveRun('trot', tmp_path / 'run', '--real-time', '--duration', '8')
    run.until_running()
    os.kill(run.children['/coordinator'], signal.SIGKILL)
    run.end()
    assert '/coordinator: was killed by SIGKILL; started again' in run.said
    summary = run.summary()
    assert summary['outcome'] == 'finished'
    assert (summary['falls'], summary['contacts']) == (0, 0)
    assert summary['sim_time_s'] == pytest.approx(8.0, abs=0.1)
