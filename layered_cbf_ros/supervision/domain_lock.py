"""One run at a time in each ROS domain: two would hear each other."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from layered_cbf_ros.errors import GraphError

LONGEST = 1_000_000  # bytes read of a lock file


class DomainLock:
    """Holds a ROS domain of this machine until it is released or the process ends.

    Attributes:
        leftovers: What the last holder noted and did not tidy up: it was killed.
    """

    def __init__(self, domain: str, folder: Path | None = None) -> None:
        """Take the domain.

        Args:
            domain: ROS_DOMAIN_ID.
            folder: Where lock files are; by default the system's temporary folder.

        Raises:
            GraphError: If another run holds it, naming its process.
        """
        path = (folder or Path(tempfile.gettempdir())) / f'layered_cbf_ros_domain_{domain}.lock'
        self._file = _open_for_all(path)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = self._content().partition('\n')[0]
            os.close(self._file)
            raise GraphError(
                f'another run (process {holder}) uses ROS domain {domain}; '
                'wait for its end or set ROS_DOMAIN_ID to another number'
            ) from None
        self.leftovers = tuple(Path(line) for line in self._content().splitlines()[1:])
        self.note(())

    def note(self, segments: Iterable[Path]) -> None:
        """Write down what must be tidied up if this process is killed.

        Args:
            segments: Lock files of shared memory that the run holds.
        """
        lines = [str(os.getpid()), *map(str, segments)]
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, ('\n'.join(lines) + '\n').encode(), 0)

    def release(self) -> None:
        """Let others have the domain."""
        self.note(())
        os.close(self._file)

    def _content(self) -> str:
        return os.pread(self._file, LONGEST, 0).decode(errors='replace')


def _open_for_all(path: Path) -> int:
    """Open a file that every user of the machine may lock."""
    try:
        return os.open(path, os.O_RDWR)
    except FileNotFoundError:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        os.fchmod(descriptor, 0o666)
        return descriptor
