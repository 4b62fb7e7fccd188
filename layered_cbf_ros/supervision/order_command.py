"""`supervisor arm`, `sit_down` and `reset`: what a person tells the drivers of real robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from layered_cbf_ros.bags.command_line import OneLineParser
from layered_cbf_ros.run_nodes import DRIVER

ORDERS = {
    'arm': 'Take over robots and stand them up: one packet seizes a robot, so look around first.',
    'sit_down': 'Let robots sit down, damp their joints and switch their motors off.',
    'reset': 'Clear the latched faults of drivers; their robots stay as they are, disarmed.',
}
"""Each order, as first argument of `supervisor`, and what it does."""
EPILOG = 'The exit code is 0 only if every robot obeyed; the first that does not is the last asked.'


@dataclass(frozen=True, slots=True)
class Order:
    """What is told to whom.

    Attributes:
        word: One of ORDERS.
        robots: Names of robots.
        timeout: How long to wait for each answer [s].
    """

    word: str
    robots: tuple[str, ...]
    timeout: float = 5.0

    def service(self, robot: str) -> str:
        """Return the service of a robot's driver that is called."""
        return f'/{robot}/{DRIVER}/{self.word}'


def parse_order(word: str, arguments: Sequence[str]) -> Order:
    """Read the command line behind the word.

    Raises:
        BagError: If it is wrong.
    """
    parser = OneLineParser(f'supervisor {word}', ORDERS[word], EPILOG)
    parser.add_argument('robots', nargs='+', metavar='ROBOT', help='names of robots, as a1_0')
    robots = parser.parse_args(arguments).robots
    return Order(word, tuple(robot.strip('/') for robot in robots))
