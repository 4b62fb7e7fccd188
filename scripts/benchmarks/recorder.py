"""The recorder as a process: what it loses, and what it costs, at the rate of four robots."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from benchmarks.row import Row
from layered_cbf_ros.bags.recording.losses import read_losses
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.interfaces import JOINT_NAMES
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.joint_state import JointStateWriter
from layered_cbf_ros.nodes.transport import Reader, find_each_other_fast
from layered_cbf_ros.supervision.status import processor_time

TOPICS = ('/state', *(f'/topic_{k}' for k in range(1, 20)))
RATE = 1000  # of each topic [Hz]: 20,000 messages a second together, as of four robots
SECONDS = 5.0
WINDOW = 60  # ticks that the sender may be ahead of the recorder in lockstep, as the simulator
DEPTH = 128  # as of the nodes of a run
PATIENCE = 30.0
RECORD = 'from layered_cbf_ros.nodes.recorder import main; main()'


@dataclass
class Figures:
    """What came of one recording: messages, those lost, and both times [s]."""

    sent: int = 0
    lost: int = 0
    processor: float = 0.0
    wall: float = 0.0


class Sender(Node):
    """Sends what four robots would."""

    def __init__(self, context: rclpy.Context) -> None:
        super().__init__('sender', context=context)
        profile = QoSProfile(depth=DEPTH)
        self._outputs = [self.create_publisher(JointState, topic, profile) for topic in TOPICS]
        self._progress = Reader(self, Header, '/recorder/progress')
        self._writer = JointStateWriter(JOINT_NAMES)
        self._values = np.random.default_rng(0).normal(size=(3, len(JOINT_NAMES)))
        self._recorded = -1
        self.tick = 0

    def wait_for_recorder(self) -> None:
        """Wait until all is subscribed."""
        end = time.monotonic() + PATIENCE
        while not all(output.get_subscription_count() for output in self._outputs):
            if time.monotonic() > end:
                raise TimeoutError('the recorder did not subscribe')
            time.sleep(0.05)

    def send(self) -> None:
        """Send one message on every topic."""
        data = self._writer.encode(self.tick * (1_000_000_000 // RATE), *self._values)
        for output in self._outputs:
            output.publish(data)
        self.tick += 1

    def wait_within(self, window: int) -> None:
        """Wait until the recorder is at most so many ticks behind."""
        end = time.monotonic() + PATIENCE
        while self.tick - 1 - self._recorded > window:
            while (data := self._progress.take()) is not None:
                self._recorded = stamp_of(data) * RATE // 1_000_000_000
            if time.monotonic() > end:
                raise TimeoutError('the recorder is silent')
            self._progress.wait(0.01)


def recorder_process_rows() -> list[Row]:
    """Record in lockstep, as fast as it goes, and against the wall clock."""
    rows = []
    for name, lockstep in (('lockstep', True), (f'{RATE * len(TOPICS)}/s', False)):
        figures = recorded(lockstep)
        per_thousand = 1e3 * figures.processor / (figures.sent / 1e3)
        rows += [
            Row(f'recorder, {name}: messages lost', figures.lost, '', 0.0, physical=lockstep),
            Row(f'recorder, {name}: processor per 1000', per_thousand, 'ms', physical=False),
            Row(f'recorder, {name}: rate', figures.sent / figures.wall, '1/s', physical=False),
        ]
    return rows


def recorded(lockstep: bool) -> Figures:
    """Record some seconds; return what came of it.

    Args:
        lockstep: The sender waits for the recorder, and for nothing else.
    """
    find_each_other_fast()  # as every node of a run
    context = rclpy.Context()
    rclpy.init(context=context)
    sender = Sender(context)
    figures = Figures()
    try:
        with tempfile.TemporaryDirectory() as folder, _recorder(Path(folder, 'bag')) as process:
            sender.wait_for_recorder()
            before, begun = processor_time(process.pid) or 0.0, time.monotonic()
            while sender.tick < RATE * SECONDS:
                sender.send()
                if lockstep:
                    sender.wait_within(WINDOW)
                else:
                    time.sleep(max(0.0, begun + sender.tick / RATE - time.monotonic()))
            sender.wait_within(0)
            figures.wall = time.monotonic() - begun
            figures.processor = (processor_time(process.pid) or 0.0) - before
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE)
            figures.sent = sender.tick * len(TOPICS)
            figures.lost = figures.sent - _found(Path(folder, 'bag'))
    finally:
        sender.destroy_node()
        rclpy.shutdown(context=context)
    return figures


@contextmanager
def _recorder(output: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a recorder of the topics."""
    command = [sys.executable, '-c', RECORD, *TOPICS, '-o', str(output)]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, env=dict(os.environ), stdout=quiet) as process:
        try:
            yield process
        finally:
            process.kill()  # does nothing to one that has ended


def _found(bag: Path) -> int:
    """Return how many messages are in a bag, which must agree with its own account."""
    reader = BagReader(bag)
    count = sum(1 for _ in reader.records())
    told = read_losses(reader.notes) or {}
    if sum(each.received for each in told.values()) != count:
        raise ValueError('the recorder tells of other messages than it has written')
    return count
