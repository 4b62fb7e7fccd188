"""What the programs that work on bags have in common: one line for an error, one exit code.

0: all is well. 1: a breach or a difference was found. 2: the bag or the command is bad,
or does not prove what was asked.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from layered_cbf_ros.errors import BagError, LayeredCbfError

EXIT_FOUND = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


class OneLineParser(argparse.ArgumentParser):
    """Reads a command line; tells in one line what is wrong with it, and help as it is written."""

    def __init__(self, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def error(self, message: str) -> NoReturn:
        """Refuse the command line.

        Raises:
            BagError: Always.
        """
        raise BagError(f'{message}; see {self.prog} --help')


def run_verb(verb: Callable[[Sequence[str]], int]) -> None:
    """Run a verb on the process's arguments, turn every error into one line, and exit.

    Args:
        verb: Takes the arguments behind the program's name; returns the exit code.
    """
    try:
        code = verb(sys.argv[1:])
        sys.stdout.flush()
    except LayeredCbfError as error:
        print(f'ERROR {error}', file=sys.stderr)
        code = EXIT_BAD_INPUT
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    except BrokenPipeError:  # as with `inspect BAG | head`: who reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    sys.exit(code)
