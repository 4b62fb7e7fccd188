"""How the page is opened to people: address, port and token, for every program that has it."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

HOST, PORT = '127.0.0.1', 8080


@dataclass(frozen=True, slots=True)
class FrontOptions:
    """Where the page is.

    Attributes:
        host: Address that it is bound to.
        port: Its port, 0 for any free one.
        token: What visitors have to know, '' for none, or a new one where it is needed.
    """

    host: str = HOST
    port: int = PORT
    token: str = ''

    def arguments(self) -> tuple[str, ...]:
        """Return the options as a command line."""
        token = ('--token', self.token) if self.token else ()
        return ('--host', self.host, '--port', str(self.port), *token)


def add_front_options(parser: argparse.ArgumentParser, prefix: str = '') -> None:
    """Add the options of the page to a command line: host, port and token.

    Args:
        parser: Of the command line.
        prefix: Before their names, for a program that has other hosts and ports, too.
    """
    parser.add_argument(
        f'--{prefix}host',
        default=HOST,
        metavar='ADDRESS',
        help=f'address of the page, {HOST} unless given; other machines then need a token',
    )
    parser.add_argument(
        f'--{prefix}port',
        type=int,
        default=PORT,
        metavar='N',
        help=f'its port, {PORT} unless given',
    )
    parser.add_argument(
        f'--{prefix}token',
        default='',
        metavar='TEXT',
        help='what visitors must know; made where needed',
    )
