"""The live side of a replay: who listens already, and the node that gets its inputs."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import String

from layered_cbf_ros.bags.playback.fed_node import FedNode
from layered_cbf_ros.errors import GraphError, MessageError
from layered_cbf_ros.nodes.message_types import message_class
from layered_cbf_ros.nodes.replay_publishers import ReplayPublishers
from layered_cbf_ros.nodes.transport import Reader, decoded, latched
from layered_cbf_ros.timing import REAL_TIME

OF_EVERY_NODE = ('/diagnostics', '/parameter_events', '/ready', '/rosout')
MANY = 100  # nodes whose latched word is kept
LOOK_S = 0.02
QUIET_S = 0.3  # no new reader for so long: those that are there have been found
ALONE_S = 1.0  # no reader at all for so long: there is none
SETTLED_S = 3.0
LISTENING_S = 30.0
TOLD_S = 1.0
ASKED_S = 5.0


def wait_for_readers(publishers: ReplayPublishers, stopped: Callable[[], bool]) -> None:
    """Wait a moment for the readers that are there already: they get the first message too.

    Args:
        publishers: What they read from.
        stopped: Tells that the replay is to end.
    """
    begun = changed = time.monotonic()
    matched = 0
    while not stopped():
        now = time.monotonic()
        if publishers.matched != matched:
            matched, changed = publishers.matched, now
        if now - changed > (QUIET_S if matched else ALONE_S) or now - begun > SETTLED_S:
            return
        time.sleep(LOOK_S)


class Partners:
    """Stands for the nodes that a fed node works with, and hears what it answers."""

    def __init__(self, node: Node, fed: FedNode) -> None:
        """Subscribe to what the fed node sends, as often as it waits for in lockstep.

        Args:
            node: Who subscribes.
            fed: Who is fed.
        """
        self._node, self._fed = node, fed
        self._recorded: dict[str, Reader] = {}
        self._ready = Reader(node, String, '/ready', latched(MANY))
        self._is_ready = False
        self._readers = [
            Reader(node, message_class(output.type_name), output.topic)
            for output in fed.outputs
            for _ in range(output.readers)
        ]

    def take(self) -> Iterator[bytes]:
        """Yield the fed node's answers since the last call."""
        while (data := self._readers[0].take()) is not None:
            yield data

    def wait_until_listening(
        self,
        publishers: ReplayPublishers,
        say: Callable[[str], None],
        stopped: Callable[[], bool],
    ) -> None:
        """Wait until the fed node is ready and reads all that it is to get.

        Args:
            publishers: What it reads from.
            say: Tells a person what is waited for.
            stopped: Tells that the replay is to end.

        Raises:
            GraphError: If it doesn't in time.
        """
        begun, told = time.monotonic(), False
        while not stopped():
            unheard = sorted(t for t in publishers.topics if not publishers.is_heard(t))
            self._listen()
            self._stand_for_the_recorder()
            if not unheard and self._is_ready:
                return
            lacks = ', '.join(unheard) + ': no listener' if unheard else 'not ready'
            waited = time.monotonic() - begun
            if waited > LISTENING_S:
                raise GraphError(
                    f'{self._fed.name} did not come in {LISTENING_S:g} s ({lacks}); start it, '
                    'with the scenario of the run, beside this'
                )
            if waited > TOLD_S and not told:
                told = True
                say(f'waiting for {self._fed.name} ({lacks})')
            time.sleep(LOOK_S)

    def in_real_time(self) -> bool:
        """Ask the fed node whether it takes the newest inputs, or waits for each of them."""
        executor = SingleThreadedExecutor(context=self._node.context)
        executor.add_node(self._node)
        asking = AsyncParameterClient(self._node, self._fed.name)
        answer = asking.get_parameters(['time'])
        executor.spin_until_future_complete(answer, ASKED_S)
        executor.remove_node(self._node)
        executor.shutdown()
        values = answer.result().values if answer.done() else []
        return [value.string_value for value in values] == [REAL_TIME]

    def _stand_for_the_recorder(self) -> None:
        """Read once all that the fed node sends: with the run's parameters it waits for that."""
        namespace, _, name = self._fed.name.rpartition('/')
        with contextlib.suppress(NodeNameNonExistentError):  # it isn't there yet
            found = self._node.get_publisher_names_and_types_by_node(name, namespace or '/')
            for topic, types in found:
                if topic not in self._recorded and topic not in OF_EVERY_NODE:
                    self._recorded[topic] = Reader(self._node, message_class(types[0]), topic)

    def _listen(self) -> None:
        while (data := self._ready.take()) is not None:
            with contextlib.suppress(MessageError):
                self._is_ready |= decoded(data, String).data == self._fed.name
