"""An emulated A1 is stood up, walks by its own sensors over a bad wire, and is lost."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from live_node import DOMAIN
from live_run import LiveRun, wait_until_gone

from layered_cbf_ros.bags.run.run_record import load_run
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages.robot_state import StateReader

pytestmark = pytest.mark.system

SCENARIO = """
description: One emulated A1 walks towards a post over UDP, as its operator wishes.
seed: 4
duration: {duration}
plant: emulated_a1
pace: {pace}
robots:
  - {{name: a1_0, position: [-1.0, 0.0]}}
obstacles:
  - {{name: post, radius: 0.25, motion: {{standing: {{position: [1.5, 0.2]}}}}}}
operator:
  - {{at: 5.0, steer: a1_0, enable: true, x: 1.0}}
emulation:
  port: {port}
  encoder_noise: 0.0005
  encoder_velocity_noise: 0.05
  gyro_noise: 0.005
  gyro_bias: 0.002
  accelerometer_noise: 0.1
  accelerometer_bias: 0.05
  tilt_bias: 0.003
  yaw_drift: 0.0003
  foot_force_noise: 3.0
  foot_force_offset: 10.0
  latency: 0.001
  loss: 0.01
  duplication: 0.005
  reordering: 0.005
  corruption: 0.005
parameters:
  a1_driver: {{local_port: {local_port}}}
"""
PORT = 20000 + 20 * DOMAIN
DRIVER = '/a1_0/a1_driver'


def begun(folder, duration, pace):
    """Start a run, slow enough for a machine that has other things to do as well."""
    values = {'duration': duration, 'pace': pace, 'port': PORT, 'local_port': PORT + 10}
    (folder / 'wire.yaml').write_text(SCENARIO.format(**values))
    return LiveRun(folder / 'wire.yaml', folder / 'run')


def ended(run):
    run.process.kill()
    run.process.wait()
    run.process.stdout.close()
    wait_until_gone(run.children.values())


def told(run, topic):
    """Return the texts of a topic, one after the other without repetitions."""
    texts = [message.data for _, message in open_bag(run.output / 'bag').messages([topic])]
    return [text for k, text in enumerate(texts) if k == 0 or text != texts[k - 1]]


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    """A finished run, its exit code, and what its bag tells."""
    run = begun(tmp_path_factory.mktemp('wire'), 8.5, 0.1)
    try:
        run.until_running()
        code = run.end()
    finally:
        ended(run)
    return run, code, load_run(run.output)


def test_it_walks_without_a_fall_and_keeps_its_distance(walk):
    run, code, record = walk
    summary = run.summary()
    assert code == 0, run.said
    assert summary['passed'], summary['reasons']
    assert (summary['falls'], summary['contacts']) == (0, 0)
    assert summary['min_clearance_m'] >= 0.3
    x = record.motions['a1_0'].configurations[:, 0]
    assert x[-1] - x[0] > 0.4  # it did walk


def test_it_lay_was_stood_up_ran_and_was_switched_off_in_order(walk):
    run, _, record = walk
    assert record.motions['a1_0'].configurations[0, 2] < 0.12
    phases = [words.partition(':')[0] for words in told(run, '/a1_0/driver_state')]
    usual = ['engaging', 'standing_up', 'standing', 'running', 'damped', 'off', 'disarmed']
    assert phases[-len(usual) :] == usual
    assert set(phases[: -len(usual)]) <= {'disarmed', 'engaging'}  # until the robot answers


def test_the_estimate_is_the_truth_within_what_the_layers_can_take(walk):
    """At equal times, the truth interpolated between its steps of 1 ms."""
    run, _, record = walk
    reader, motion = StateReader('a1_0'), record.motions['a1_0']
    states = [
        reader.read(each.data) for each in open_bag(run.output / 'bag').records({'/a1_0/state'})
    ]
    states = [state for state in states if state.stamp_ns < motion.stamps_ns[-1]]
    times = np.array([state.stamp_ns for state in states])
    rows = np.searchsorted(motion.stamps_ns, times)
    estimated = np.array([state.configuration[:3] for state in states])
    velocity = np.array([state.velocity[:3] for state in states])
    true, true_velocity = motion.configurations[rows, :3], motion.velocities[rows, :3]
    error = estimated - true
    assert np.abs(error[:, 2]).max() < 0.010
    rmse = np.sqrt(((velocity - true_velocity) ** 2).sum(axis=1).mean())
    assert rmse < 0.05
    walked = np.abs(np.diff(true[:, 0])).sum()
    drift = np.linalg.norm(error[-1, :2] - error[0, :2])
    assert drift < 0.02 * walked + 0.005  # the noise of a single sample
    assert times[0] > 2.0 * NS_PER_S  # nothing is told of a robot that lies


def test_spoilt_packets_are_refused_and_counted(walk):
    _, _, record = walk
    assert 'checksum' in record.diagnostics[DRIVER]['states_refused']
    assert 'checksum' in record.diagnostics['/a1_emulator']['a1_0/refused']


def test_without_its_driver_a_robot_sinks_down_and_the_run_goes_on(tmp_path):
    """Nothing can damp its joints any more but the robot itself."""
    run = begun(tmp_path, 7.0, 0.25)
    try:
        run.until_running()
        time.sleep(4.2 / 0.25)  # it stands by now
        os.kill(run.children[DRIVER], signal.SIGKILL)
        assert run.end() == 1
    finally:
        ended(run)
    assert f'{DRIVER} was killed by SIGKILL' in run.said or 'SIGKILL; its robot' in run.said
    height = load_run(run.output).motions['a1_0'].configurations[:, 2]
    assert height.max() > 0.25
    assert height[-1] < 0.15
    assert np.diff(height).min() > -0.003  # braked by its motors: no free fall
