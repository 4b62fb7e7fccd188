"""The websocket of the open pages: hears what is held on them, tells them how it goes."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from aiohttp import WSMsgType, web

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.operation.virtual_pad import PadState
from layered_cbf_ros.viewing.front import operator_lock
from layered_cbf_ros.viewing.front.figures import figures_of
from layered_cbf_ros.viewing.front.operator_lock import Lock
from layered_cbf_ros.viewing.front.page_messages import PageMessage, read_page_message
from layered_cbf_ros.viewing.front.team import Team
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

BEAT_S = 1.0 / 30.0
FIGURES_EVERY = 3  # beats
OLDEST_S = 0.25  # of what a page answers to: the way there, a turn of the page, the way back
LONGEST = 4096  # bytes of a message
SLOWEST_S = 1.0  # for a page to take a beat; then its connection is given up
LET_GO = 'everybody was stopped: let go of the stick first'


@dataclass
class Page:
    """One open page.

    Attributes:
        name: Ours for it.
        number: Count of its last message.
        word: What its person has to be told with the next beat, '' if nothing.
        refused: How many of its messages were refused.
    """

    name: str
    number: int = -1
    word: str = ''
    refused: int = 0


class OperatorSocket:
    """Joins the pages, the lock that lets one of them steer, and the team.

    Attributes:
        pages: How many are open.
    """

    def __init__(self, team: Team | None, sight: Callable[[], Snapshot | None]) -> None:
        """Begin without a page.

        Args:
            team: Passes wishes on; None if there is nobody to steer, as in a bag.
            sight: Returns the newest sight of the run.
        """
        self._team, self._sight = team, sight
        self._lock = Lock()
        self.pages = self._opened = 0
        self._figures: dict[str, Any] = figures_of(None)
        self._turn = 0

    async def handle(self, request: web.Request) -> web.WebSocketResponse:
        """Serve one page until it is gone."""
        socket = web.WebSocketResponse(max_msg_size=LONGEST, compress=False)
        await socket.prepare(request)
        self.pages, self._opened = self.pages + 1, self._opened + 1
        page = Page(f'page {self._opened}')
        telling = asyncio.create_task(self._tell(page, socket))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    self._hear(page, message.data)
        finally:
            self.pages -= 1
            self._lock = operator_lock.left(self._lock, page.name, time.monotonic())
            telling.cancel()
            await asyncio.gather(telling, return_exceptions=True)
        return socket

    async def stop(self, request: web.Request) -> web.Response:
        """Take an emergency stop that doesn't come over the websocket: that one may be stuck."""
        self._lock = operator_lock.stopped(self._lock)
        return web.Response(text='stopped')

    def close(self) -> None:
        """Let go of what is held, and say all that is still to be said."""
        now = time.monotonic()
        lock, pad = operator_lock.passed(operator_lock.left(self._lock, self._lock.owner, now), now)
        while pad is not None:
            self._operate(pad)
            lock, pad = operator_lock.passed(lock, now)

    async def watch(self) -> None:
        """Send what time brings: the end of a silent owner, and what is said repeatedly."""
        due = time.monotonic()
        while True:
            now = time.monotonic()
            self._lock, pad = operator_lock.passed(self._lock, now)
            if pad is not None:
                self._operate(pad)
            if self._turn % FIGURES_EVERY == 0:
                self._figures = figures_of(self._sight())
            self._turn += 1
            due = max(due + BEAT_S, now)
            await asyncio.sleep(due - now)

    def _hear(self, page: Page, text: str) -> None:
        """Take one message of a page; what is wrong with it, its person is told."""
        now = time.monotonic()
        robots = [robot['name'] for robot in self._figures['robots']]
        try:
            message = read_page_message(text, robots)
            self._check_age(page, message, now)
        except MessageError as error:
            page.word, page.refused = str(error), page.refused + 1
            return
        self._lock, pad, refused = operator_lock.heard(self._lock, page.name, message.pad, now)
        if pad is not None:
            self._operate(pad)
        if refused:
            barred = self._lock.barred == page.name
            page.word, page.refused = LET_GO if barred else self._who_steers(), page.refused + 1

    def _operate(self, pad: PadState) -> None:
        if self._team is not None:
            self._team.operate(pad)

    def _check_age(self, page: Page, message: PageMessage, now: float) -> None:
        """Refuse what was held a while ago, but an emergency stop never.

        Raises:
            MessageError: If the message is old or comes twice.
        """
        age, page.number, before = now - message.answers, message.number, page.number
        if message.pad.e_stop or not operator_lock.takes_in_hand(message.pad):
            return
        if not 0.0 <= age <= OLDEST_S or message.number <= before:
            raise MessageError(f'the connection is too slow to steer: {age:.2f} s there and back')

    def _who_steers(self) -> str:
        steered = [robot['name'] for robot in self._figures['robots'] if robot['steered']]
        return f'{", ".join(steered) or "the team"} is steered from another page'

    async def _tell(self, page: Page, socket: web.WebSocketResponse) -> None:
        """Send a page beats, and every third time the figures, while it takes them."""
        turn = 0
        while not socket.closed:
            now = time.monotonic()
            beat: dict[str, Any] = {'beat': now, 'control': self._lock.seen_by(page.name, now)}
            if page.word:
                beat['word'], page.word = page.word, ''
            if turn % FIGURES_EVERY == 0:
                beat |= {'figures': self._figures, 'steers': self._team is not None}
            try:
                await asyncio.wait_for(socket.send_str(json.dumps(beat)), SLOWEST_S)
            except (TimeoutError, asyncio.TimeoutError, ConnectionError):
                await socket.close()
            turn += 1
            await asyncio.sleep(BEAT_S)
