"""One child process: started, listened to, signalled, and its end named."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from layered_cbf_ros.errors import EXIT_MISSING
from layered_cbf_ros.supervision import shared_memory
from layered_cbf_ros.supervision.process_plan import ProcessSpec

MISSING = re.compile(r'MISSING (\S+?):? ')
CHUNK = 65536

Tell = Callable[[str, str], None]


def node_command(spec: ProcessSpec, parent: int) -> list[str]:
    """Return the command that runs a node of this package as our child."""
    death_signal = signal.SIGTERM if spec.ends_itself else signal.SIGKILL
    program = (
        'from layered_cbf_ros.supervision.parent import tie_to_parent\n'
        f'tie_to_parent({parent}, {int(death_signal)})\n'
        f'from layered_cbf_ros.nodes.{spec.executable} import main\n'
        'main()\n'
    )
    return [sys.executable, '-c', program, *spec.arguments]


class Child:
    """A running process, its output split into lines.

    Its output is read when it is polled, without threads: who polls twenty times a
    second sees every line while it is fresh.

    Attributes:
        name: Name of its node.
        pid: Its process id.
        missing: Whom it said it waited for in vain, '' if it didn't.
        segments: Lock files of the shared memory it was seen to hold.
    """

    def __init__(
        self,
        spec: ProcessSpec,
        command: list[str],
        folder: Path,
        variables: Mapping[str, str],
        tell: Tell,
    ) -> None:
        """Start it.

        Args:
            spec: What it is.
            command: Program and arguments.
            folder: The run's folder: it works there, and its log is in `logs/`.
            variables: Its environment.
            tell: Called with its name and each line it prints.
        """
        self.name = spec.name
        self.missing = ''
        self._tell = tell
        self._rest = b''
        self.segments: frozenset[Path] = frozenset()
        self._log = (folder / 'logs' / spec.log_name).open('ab')
        self._pipe, its_end = os.pipe()
        os.set_blocking(self._pipe, False)
        try:
            self._process = subprocess.Popen(
                command,
                cwd=folder,
                env=dict(variables),
                stdin=subprocess.DEVNULL,
                stdout=its_end,
                stderr=its_end,
            )
        finally:
            os.close(its_end)
        self.pid = self._process.pid

    def poll(self) -> int | None:
        """Pass its new lines on; return its exit code once it has ended."""
        code = self._process.poll()
        self._listen()
        if code is not None and not self._log.closed:
            self._finish(code)
        return code

    def note_resources(self) -> None:
        """Remember which shared memory it holds, to tidy up should it be killed."""
        self.segments |= shared_memory.held_by(self.pid)

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, if it still runs."""
        if number == signal.SIGKILL:
            self.note_resources()
        if self._process.poll() is None:
            self._process.send_signal(number)

    def _listen(self) -> None:
        while not self._log.closed:
            try:
                data = os.read(self._pipe, CHUNK)
            except BlockingIOError:
                return
            if not data:
                return
            self._log.write(data)
            self._log.flush()
            *lines, self._rest = (self._rest + data).split(b'\n')
            for line in lines:
                self._hear(line)

    def _hear(self, line: bytes) -> None:
        text = line.decode(errors='replace').rstrip()
        found = MISSING.match(text)
        if found and not self.missing:
            self.missing = found[1]
        self._tell(self.name, text)

    def _finish(self, code: int) -> None:
        if self._rest:
            self._hear(self._rest)
        self._log.close()
        os.close(self._pipe)
        if code < 0:
            shared_memory.remove(self.segments)


def describe_exit(code: int) -> str:
    """Say in words how a process ended."""
    if code == 0:
        return 'ended'
    if code == EXIT_MISSING:
        return 'gave up waiting (exit 3)'
    if code > 0:
        return f'failed (exit {code})'
    try:
        return f'was killed by {signal.Signals(-code).name}'
    except ValueError:
        return f'was killed by signal {-code}'
