"""recorder: writes topics, byte for byte, into a bag, and counts what is lost on the way."""

from __future__ import annotations

import contextlib
import itertools
import signal
import sys
import time
from pathlib import Path
from typing import TextIO

from std_msgs.msg import Header

from layered_cbf_ros.bags.recording.command_line import ros_arguments
from layered_cbf_ros.bags.recording.losses import (
    NOTE,
    REFUSED_NOTE,
    TopicLosses,
    note_of,
    summary,
    table,
)
from layered_cbf_ros.bags.recording.parameters import RecorderParameters
from layered_cbf_ros.bags.recording.progress import recorded_up_to
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.errors import BagError, StopRequestedError
from layered_cbf_ros.health import Fault, Level
from layered_cbf_ros.messages.standard import header
from layered_cbf_ros.nodes.declaring import declare
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.nodes.recorded_topic import RecordedTopic
from layered_cbf_ros.nodes.running import run_node

PROGRESS = '/recorder/progress'
PAUSE_S = 0.005
DISCOVERY_NS = 50_000_000
FLUSH_NS = 1_000_000_000
LAST_TURNS = 100  # some who publish never stop
EXIT_LOST = 1


class RecorderNode(GraphNode):
    """Drains every topic a few hundred times a second."""

    def __init__(self) -> None:
        super().__init__('recorder')
        parameters = declare(self, RecorderParameters)
        self.refuse_unknown_parameters()  # before there is a folder
        name = parameters.output or time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
        self._selection = parameters.selection
        self._bag = BagWriter(Path(name).absolute(), storage=parameters.storage)
        self._topics: dict[str, RecordedTopic] = {}
        self._refused: dict[str, str] = {}
        self._progress = self.create_publisher(Header, PROGRESS, 10)
        signal.signal(signal.SIGHUP, self._request_stop)  # its terminal was closed
        self._told_ns = -1
        self._next_discovery_ns = self._next_flush_ns = 0
        self._say(f'recording into {self._bag.path}; Ctrl-C ends it')

    def run(self) -> None:
        """Record until asked to end, then drain what has arrived and close the bag."""
        self.tell_ready()
        try:
            while True:
                self.serve()
                now_ns = time.monotonic_ns()
                if now_ns >= self._next_discovery_ns:
                    self._next_discovery_ns = now_ns + DISCOVERY_NS
                    self._discover()
                if now_ns >= self._next_flush_ns:
                    self._next_flush_ns = now_ns + FLUSH_NS
                    self._keep_up()
                self._turn()
                time.sleep(PAUSE_S)
        except StopRequestedError:
            turns = itertools.count()
            while self._drain() and next(turns) < LAST_TURNS:
                pass
            self._conclude()
            raise
        finally:
            self._bag.close()

    def _discover(self) -> None:
        """Subscribe to every topic that has appeared and is wanted."""
        for topic, types in self.get_topic_names_and_types():
            if topic in self._topics or topic in self._refused or not self._wants(topic):
                continue
            if not self.count_publishers(topic):
                continue
            try:
                recorded = RecordedTopic(self, topic, types[0], self._bag)
            except BagError as error:
                self._refuse(topic, str(error))
                continue
            self._topics[topic] = recorded
            self._say(f'+ {recorded.described()}')
            if len(types) > 1:
                self._refuse(topic, f'only {types[0]} is recorded, not {", ".join(types[1:])}')

    def _wants(self, topic: str) -> bool:
        return topic != PROGRESS and self._selection.wants(topic)

    def _refuse(self, topic: str, reason: str) -> None:
        """Tell once that something is not recorded."""
        self._refused[topic] = reason
        self.statistics.reject(f'{topic}: {reason}')
        _tell(f'NOT RECORDED {topic}: {reason}', sys.stderr)

    def _keep_up(self) -> None:
        """Do once a second what needn't be done for each message."""
        for topic in self._topics.values():
            self._say(topic.follow())
            topic.progress.refresh()
        self._note()
        self._bag.flush()
        put_back = self._bag.keep()
        if put_back:
            _tell(f'WARNING {put_back}', sys.stderr)
        self._tell_health()

    def _tell_health(self) -> None:
        """Say what is in the bag, and what is not."""
        refused = ' '.join(sorted(self._refused))
        statistics = self.statistics
        statistics.lost = self._lost
        statistics.details['received'] = str(sum(each.received for each in self._losses().values()))
        statistics.details['dropped_topics'] = refused
        if refused:
            statistics.faults = (Fault('refused', Level.WARN, f'not recorded: {refused}'),)

    def _turn(self) -> None:
        """Drain once; for this node that is what others call a tick, but messages count."""
        self.statistics.begin(time.monotonic_ns())
        begun_ns = time.perf_counter_ns()
        count = self._drain()
        self.statistics.tick(time.perf_counter_ns() - begun_ns, count)

    def _drain(self) -> int:
        """Write what has arrived, tell the simulator how far that is, and return how many."""
        count = sum(topic.drain() for topic in self._topics.values())
        state = self._topics.get(self.state_topic)
        if state is not None and state.stamps.last_ns is not None:
            followed = (topic.progress for topic in self._topics.values())
            stamp_ns = recorded_up_to(state.stamps.last_ns, followed)
            if stamp_ns > self._told_ns:
                self._told_ns = stamp_ns
                self._progress.publish(header(stamp_ns))
        return count

    def _conclude(self) -> None:
        """Close the bag, and say what became of every topic."""
        losses = self._losses()
        self._note()
        where = self._bag.path
        self._bag.close({NOTE: summary(losses, list(self._refused))})
        self._say('\n'.join(table(losses)))
        _tell(f'{summary(losses, list(self._refused))}: {where}')
        incomplete = self.statistics.rejected or self._refused or self._lost
        self.exit_code = EXIT_LOST if incomplete else 0

    def _note(self) -> None:
        self._bag.note(NOTE, note_of(self._losses()))
        self._bag.note(REFUSED_NOTE, self._refused)

    def _losses(self) -> dict[str, TopicLosses]:
        return {name: topic.losses for name, topic in self._topics.items()}

    @property
    def _lost(self) -> int:
        return sum(topic.sequences.lost for topic in self._topics.values())

    def _say(self, text: str) -> None:
        """Say something, unless a supervisor runs this: then there are many others."""
        if text and not self.recorded:
            _tell(text)


def _tell(text: str, stream: TextIO | None = None) -> None:
    """Print, and go on recording even if nobody listens any more."""
    with contextlib.suppress(OSError):
        print(text, file=stream or sys.stdout, flush=True)


def main() -> None:
    """Run the node."""
    sys.argv[1:] = ros_arguments(sys.argv[1:])
    run_node(RecorderNode)
