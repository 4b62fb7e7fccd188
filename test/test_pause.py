"""Time can be held still: nobody gives up, and the run goes on with the same bits."""

from __future__ import annotations

import time

import pytest

pytest.importorskip('rclpy')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from live_node import DOMAIN
from live_run import LiveRun
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import PAUSE, STEP

pytestmark = pytest.mark.system

WALK = """
description: One A1 walks for a second{mode}.
duration: {duration}
{time}
robots:
  - {{name: a1_0, position: [0.0, 0.0], desired: {{velocity: [{{at: 0.2, x: 0.3}}]}}}}
parameters:
  coordinator: {{patience: 2.0}}
  ground_force_mpc: {{patience: 2.0}}
  whole_body_controller: {{patience: 2.0}}
  simulator: {{patience: 2.0}}
"""
HELD_S = 4.0  # twice as long as any node waits for another
LIMIT_S = 60.0


class Caller:
    """A person at the simulator's services, who also reads the clock and its diagnostics."""

    def __init__(self):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self._node = Node('caller', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.pause = self._node.create_client(SetBool, PAUSE)
        self.step = self._node.create_client(Trigger, STEP)
        self.clock_ns, self.figures = -1, {}
        self._node.create_subscription(Clock, '/clock', self._on_clock, 10)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_figures, 50)

    def _on_clock(self, message):
        self.clock_ns = message.clock.sec * NS_PER_S + message.clock.nanosec

    def _on_figures(self, message):
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            self.figures[status.name] = values

    def call(self, client, request):
        assert client.wait_for_service(LIMIT_S)
        future = client.call_async(request)
        self._executor.spin_until_future_complete(future, LIMIT_S)
        return future.result()

    def until(self, condition):
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, (self.clock_ns, self.figures)
            self._executor.spin_once(timeout_sec=0.05)

    def listen(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self):
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def start(tmp_path):
    runs, callers = [], []

    def start(name, duration=1.0, mode='lockstep'):
        scenario = tmp_path / f'{name}.yaml'
        time_line = '' if mode == 'lockstep' else f'time: {mode}'
        scenario.write_text(WALK.format(duration=duration, mode='', time=time_line))
        runs.append(LiveRun(scenario, tmp_path / name))
        callers.append(Caller())
        return runs[-1], callers[-1]

    yield start
    for caller in callers:
        caller.close()
    for run in runs:
        run.process.terminate()
        run.process.wait()
        run.process.stdout.close()


def test_a_held_run_stands_still_steps_exactly_and_ends_with_the_same_bits(start):
    undisturbed, _ = start('undisturbed')
    undisturbed.end()

    run, person = start('held')
    person.until(lambda: person.clock_ns > 0)
    refused = person.call(person.step, Trigger.Request())
    assert not refused.success
    assert 'not paused' in refused.message
    assert person.call(person.pause, SetBool.Request(data=True)).success
    person.until(lambda: person.figures.get('/simulator', {}).get('paused') == 'true')
    held_ns = person.clock_ns
    ticks = int(person.figures['/simulator']['ticks'])
    person.listen(HELD_S)
    assert person.clock_ns == held_ns
    assert int(person.figures['/simulator']['ticks']) == ticks

    for _ in range(5):
        assert person.call(person.step, Trigger.Request()).success
    person.until(lambda: int(person.figures['/simulator']['ticks']) >= ticks + 10)
    person.listen(1.2)  # one more round of diagnostics
    assert int(person.figures['/simulator']['ticks']) == ticks + 10  # five plans of two ticks

    assert person.call(person.pause, SetBool.Request(data=False)).success
    run.end()
    assert run.summary()['outcome'] == 'finished'
    assert run.summary()['trajectory_sha256'] == undisturbed.summary()['trajectory_sha256']


def test_in_real_time_nobody_can_hold_the_time(start):
    _, person = start('real', duration=30.0, mode='real_time')
    answer = person.call(person.pause, SetBool.Request(data=True))
    assert not answer.success
    assert 'real time' in answer.message
    before = person.clock_ns
    person.until(lambda: person.clock_ns > max(before, 0))
