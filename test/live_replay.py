"""A replay as a process of its own, with or without a terminal, and who listens to it."""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from live_node import DOMAIN, ENVIRONMENT
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

PROGRAM = 'from layered_cbf_ros.nodes.replay import main; main()'
LIMIT_S = 60.0
DEPTH = 5000


class Listener:
    """Keeps the bytes of all that comes, with the time it was sent."""

    def __init__(self) -> None:
        os.environ.update(ENVIRONMENT)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self.node = Node('listener', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._heard: list[tuple[int, str, bytes]] = []

    def listen(self, topic: str, kind: type, qos: QoSProfile | None = None) -> None:
        """Subscribe to a topic."""

        def note(data: bytes, information: dict) -> None:
            self._heard.append((information['source_timestamp'], topic, bytes(data)))

        profile = qos or QoSProfile(depth=DEPTH)
        self.node.create_subscription(kind, topic, note, profile, raw=True)

    @property
    def heard(self) -> list[tuple[str, bytes]]:
        """Return topic and bytes of all messages, in the order they were sent in."""
        return [(topic, data) for _, topic, data in sorted(self._heard)]

    def until(self, condition: Callable[[], bool]) -> None:
        """Listen until something holds; fail after a while."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, f'never came true; {len(self._heard)} were heard'
            self._executor.spin_once(timeout_sec=0.01)

    def until_ended(self, replay: LiveReplay) -> None:
        """Listen until a replay has ended, and take what is still on its way."""
        self.until(lambda: replay.process.poll() is not None)
        count = -1
        while len(self._heard) != count:
            count = len(self._heard)
            for _ in range(20):
                self._executor.spin_once(timeout_sec=0.01)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


class LiveReplay:
    """A running replay.

    Attributes:
        program: What is run; of another program on a terminal, its own.
        screen: What it has shown on its terminal, if it has one.
    """

    program = PROGRAM

    def __init__(self, *arguments: str | Path, terminal: bool = False) -> None:
        self.screen = b''
        self._outer, inner = pty.openpty() if terminal else (-1, subprocess.DEVNULL)
        self._inner = inner
        self.process = subprocess.Popen(
            [sys.executable, '-c', self.program, *map(str, arguments)],
            env=ENVIRONMENT | {'TERM': 'xterm', 'COLUMNS': '200'},
            stdin=inner,
            stdout=inner if terminal else subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=terminal,
            preexec_fn=(lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0)) if terminal else None,  # noqa: PLW1509
        )
        if terminal:
            os.set_blocking(self._outer, False)
            self.before = self.terminal_modes()

    def terminal_modes(self) -> list:
        """Return how the terminal behaves."""
        return termios.tcgetattr(self._inner)

    def press(self, keys: bytes) -> None:
        """Type on its terminal."""
        os.write(self._outer, keys)

    def shows(self, words: bytes) -> bool:
        """Tell whether its terminal has shown something."""
        try:
            while part := os.read(self._outer, 1 << 16):
                self.screen += part
        except BlockingIOError:
            pass
        return words in self.screen

    def interrupt(self, number: int = signal.SIGINT) -> None:
        self.process.send_signal(number)

    def end(self) -> tuple[int, str, list[str]]:
        """Wait for its end; return exit code, output, and the lines of its errors."""
        output, errors = self.process.communicate(timeout=LIMIT_S)
        return self.process.returncode, (output or b'').decode(), errors.decode().splitlines()

    def close(self) -> None:
        """End it, whatever state it is in."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()
        if self._outer >= 0:
            os.close(self._outer)
            os.close(self._inner)
