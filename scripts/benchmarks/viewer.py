"""What the page costs a lockstep run of four robots, and how often it is drawn.

The page's visitor is a client that takes everything and draws nothing: a browser without
a graphics card would take a processor for itself.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import socket
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import aiohttp
import viser

from benchmarks.row import Row

SCENARIO, DURATION = 'four_agents', 5.0  # simulated time [s]
ORDER = (False, True, True, False, False, True)
"""Which runs are watched: pairs in turn, so that a machine that slows down favours none."""
HEARTBEAT = 100  # bytes; a message that draws is larger


def viewer_rows(supervisor: list[str]) -> list[Row]:
    """Return the slow-down by a page that is watched, and its frames a second of wall time."""
    speeds: dict[bool, list[float]] = {False: [], True: []}
    frames: list[float] = []
    for watched in ORDER:
        speed, rate = _run(supervisor, watched)
        speeds[watched].append(speed)
        frames += [rate] if watched else []
    without, beside = (sum(speeds[watched]) / len(speeds[watched]) for watched in (False, True))
    slower = 100.0 * (1.0 - beside / without)
    spread = 100.0 * (max(speeds[False]) - min(speeds[False])) / without
    return [
        Row('page: slow-down of a lockstep run', slower, '%', 5.0, physical=False,
            details={'spread without a page, %': spread, 'real-time factor': without}),
        Row('page: frames a second', min(frames), 'Hz', 30.0, at_least=True, physical=False),
    ]  # fmt: skip


def _run(supervisor: list[str], watched: bool) -> tuple[float, float]:
    """Return the real-time factor of a run, and the frames a second that its visitor got."""
    port, rate = _free_port(), math.nan
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder, 'run')
        command = [*supervisor, SCENARIO, '--duration', str(DURATION), '--output', str(run)]
        command += ['--viewer', '--page-port', str(port)] if watched else []
        variables = {'ROS_DOMAIN_ID': str(1 + os.getpid() % 100), **os.environ}
        with subprocess.Popen(command, env=variables, stdout=subprocess.DEVNULL) as process:
            if watched:
                visitor = Visitor(port, process)
                process.wait()
                rate = visitor.rate()
        summary = json.loads((run / 'summary.json').read_text())
    return summary['real_time_factor'], rate


def _free_port() -> int:
    with socket.socket() as trial:
        trial.bind(('127.0.0.1', 0))
        return int(trial.getsockname()[1])


class Visitor:
    """Takes all that the page's scene sends, until its server goes."""

    def __init__(self, port: int, server: subprocess.Popen[bytes]) -> None:
        self._port, self._server = port, server
        self._times: list[float] = []
        self._thread = threading.Thread(target=lambda: asyncio.run(self._visit()), daemon=True)
        self._thread.start()

    def rate(self) -> float:
        """Return the frames a second in the middle half of the visit [Hz]."""
        self._thread.join()
        quarter = len(self._times) // 4
        middle = self._times[quarter:-quarter]
        return (len(middle) - 1) / (middle[-1] - middle[0]) if len(middle) > 1 else 0.0

    async def _visit(self) -> None:
        door, protocol = f'127.0.0.1:{self._port}', f'viser-v{viser.__version__}'
        async with aiohttp.ClientSession() as session:
            while not self._times and self._server.poll() is None:
                try:
                    async with session.ws_connect(
                        f'ws://{door}/view/',
                        origin=f'http://{door}',
                        protocols=[protocol],
                        max_msg_size=0,
                    ) as scene:
                        async for message in scene:
                            if len(message.data) > HEARTBEAT:
                                self._times.append(time.monotonic())
                except aiohttp.ClientError:
                    await asyncio.sleep(0.1)
