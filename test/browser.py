"""A real Chromium for the pages of the viewer, and a front with a made-up team behind it."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from aiohttp import WSMsgType, web

from layered_cbf_ros.viewing.front.front import Front
from layered_cbf_ros.viewing.front.options import FrontOptions
from layered_cbf_ros.viewing.sight.snapshot import BarrierSight, RobotSight, Snapshot

FLAGS = (
    *('--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'),
    *('--no-first-run', '--disable-background-networking', '--disable-component-update'),
    *('--disable-sync', '--disable-dev-shm-usage'),
)
LAPTOP, PHONE = (1280, 800), (390, 844)
LIMIT_S = 20.0


@contextlib.contextmanager
def chromium():
    """Yield a headless Chromium; if there is none, the test fails and says what to do."""
    path = shutil.which('chromium') or shutil.which('google-chrome') or '/usr/bin/chromium'
    if not Path(path).exists():
        pytest.fail('no Chromium here; install one: apt install chromium')
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


def until(condition, page=None):
    """Wait until something is true; a page's own events are served meanwhile."""
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, 'never came true'
        if page is None:
            time.sleep(0.01)
        else:
            page.wait_for_timeout(20)


class FakeTeam:
    """Stands for the node graph: remembers what it is asked.

    Attributes:
        pads: What was held on the virtual pad, and when [s].
        stopped, paused: What its run tells.
    """

    def __init__(self, names=('a1_0', 'a1_1')):
        self.pads = []
        self.names = names
        self.stopped = self.paused = False
        self.began = time.monotonic()

    def operate(self, pad):
        self.pads.append((time.monotonic(), pad))
        self.stopped = self.stopped or pad.e_stop

    @property
    def last(self):
        return self.pads[-1][1]

    def sight(self):
        """Return a run in which the first robot is steered, 0.42 m from the second."""
        robots = tuple(
            RobotSight(
                name=name,
                configuration=np.zeros(19),
                velocity=np.array([0.3, -0.4]),
                foot_positions=np.zeros((4, 3)),
                foot_forces=np.zeros((4, 3)),
                has_legs=True,
                radius=0.3,
                plan=None,
                target=np.zeros(2),
                reach=np.zeros(3),
                intervention=0.12,
                is_held=False,
                is_steered=name == 'a1_0',
            )
            for name in self.names
        )
        barriers = (
            BarrierSight('a1_0~a1_1', 0.42, 0.0, 0.0, 0.0),
            BarrierSight('a1_1~cart', 0.05, 0.0, 0.0, 0.0),
        )
        stamp_ns = int((time.monotonic() - self.began) * 1e9)
        return Snapshot(
            stamp_ns, robots, barriers=barriers, is_stopped=self.stopped, is_paused=self.paused
        )


class FakeScene:
    """Stands for the server of the 3D scene: a small page, and a websocket that echoes."""

    def __init__(self):
        self.port = 0
        self._loop = asyncio.new_event_loop()
        self._begun, self._end = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(),))
        self._thread.start()
        assert self._begun.wait(LIMIT_S)

    async def _run(self):
        application = web.Application()
        application.add_routes([web.get('/{path:.*}', self._answer)])
        runner = web.AppRunner(application)
        await runner.setup()
        site = web.TCPSite(runner, '127.0.0.1', 0)
        await site.start()
        self.port = runner.addresses[0][1]
        self._begun.set()
        await self._end.wait()
        await runner.cleanup()

    async def _answer(self, request):
        if 'Upgrade' not in request.headers:
            text = f'<p>scene {request.path}</p><input id="text">'
            return web.Response(text=text, content_type='text/html')
        socket = web.WebSocketResponse(protocols=('viser-v9',))
        await socket.prepare(request)
        async for message in socket:
            if message.type is WSMsgType.BINARY:
                await socket.send_bytes(message.data[::-1])
            else:
                await socket.send_str(f'{socket.ws_protocol}: {message.data}')
        return socket

    def close(self):
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(LIMIT_S)
        self._loop.close()


@contextlib.contextmanager
def fake_front(**options):
    """Yield a front on a free port, and the made-up team behind it."""
    scene, team = FakeScene(), FakeTeam()
    front = Front(FrontOptions(port=0, **options), scene.port, team.sight, team)
    try:
        yield front, team
    finally:
        front.close()
        scene.close()
