"""Who may enter, who steers, and what becomes of a page that is silent, late or gone."""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import socket
import time
from dataclasses import replace

import aiohttp
import pytest
from browser import FakeTeam, fake_front, until

from layered_cbf_ros.errors import MessageError, ParameterError
from layered_cbf_ros.operation.virtual_pad import PadState
from layered_cbf_ros.viewing.front import operator_lock
from layered_cbf_ros.viewing.front.door import is_loopback, make_door
from layered_cbf_ros.viewing.front.figures import figures_of
from layered_cbf_ros.viewing.front.operator_lock import GRACE_S, SILENCE_S, Lock
from layered_cbf_ros.viewing.front.options import FrontOptions, add_front_options
from layered_cbf_ros.viewing.front.page_messages import read_page_message
from layered_cbf_ros.viewing.front.port import listen

HELD, LET_GO, STOP = PadState(x=1.0, enable=True), PadState(), PadState(e_stop=True)


# --- the lock ----------------------------------------------------------------------


class Lockplay:
    """Plays what pages say to a lock, and keeps what it sends."""

    def __init__(self):
        self.lock, self.sent = Lock(), []

    def say(self, page, pad, now):
        self.lock, sent, refused = operator_lock.heard(self.lock, page, pad, now)
        self.sent += [] if sent is None else [sent]
        return refused

    def wait(self, begin, end):
        """Let time pass, turn by turn; return what was sent."""
        before, now = len(self.sent), begin
        while now <= end:
            self.lock, sent = operator_lock.passed(self.lock, now)
            self.sent += [] if sent is None else [sent]
            now += 1.0 / 30.0
        return self.sent[before:]


def test_the_first_hand_on_the_stick_keeps_every_other_off_it():
    play = Lockplay()
    assert not play.say('a', HELD, 0.0)
    assert play.say('b', HELD, 0.05)
    assert play.sent == [HELD]
    assert play.lock.seen_by('a', 0.05) == 'yours'
    assert play.lock.seen_by('b', 0.05) == 'other'


def test_the_next_one_gets_the_stick_a_moment_after_it_was_let_go():
    play = Lockplay()
    play.say('a', HELD, 0.0)
    play.say('a', LET_GO, 0.1)
    assert play.say('b', HELD, 0.1 + 0.9 * GRACE_S)
    assert not play.say('b', HELD, 0.1 + 1.1 * GRACE_S)
    assert play.lock.owner == 'b'


def test_what_is_let_go_is_sent_at_once_and_again():
    play = Lockplay()
    play.say('a', HELD, 0.0)
    play.say('a', LET_GO, 0.02)
    assert play.sent[-1] == LET_GO
    again = play.wait(0.02, 1.0)
    assert 1 <= len(again) <= 10
    assert set(map(str, again)) == {str(LET_GO)}


def test_a_silent_page_has_let_go_and_later_loses_the_control():
    play = Lockplay()
    play.say('a', HELD, 0.0)
    assert play.wait(0.0, 0.9 * SILENCE_S) == []
    assert LET_GO in play.wait(SILENCE_S, SILENCE_S + 0.1)
    assert play.say('b', HELD, SILENCE_S + 0.1)
    assert not play.say('b', HELD, SILENCE_S + GRACE_S + 0.1)


def test_a_page_that_is_gone_lets_go_and_another_may_steer_at_once():
    play = Lockplay()
    play.say('a', HELD, 0.0)
    play.lock = operator_lock.left(play.lock, 'a', 0.05)
    assert not play.say('b', HELD, 0.06)
    gone = Lockplay()
    gone.say('a', HELD, 0.0)
    gone.lock = operator_lock.left(gone.lock, 'a', 0.05)
    assert LET_GO in gone.wait(0.05, 0.1)


def test_a_stranger_who_leaves_takes_nothing_from_the_owner():
    play = Lockplay()
    play.say('a', HELD, 0.0)
    play.lock = operator_lock.left(play.lock, 'b', 0.05)
    assert play.lock.seen_by('a', 0.05) == 'yours'
    assert play.wait(0.05, 0.1) == []


def test_anybody_may_stop_and_nothing_moves_until_the_stick_is_taken_anew():
    play = Lockplay()
    play.say('a', HELD, 0.0)
    assert not play.say('b', STOP, 0.1)
    assert play.wait(0.1, 0.4)[:5] == [STOP] * 5
    assert play.say('a', HELD, 0.4)  # it was never let go
    assert HELD not in play.sent[1:]
    play.say('a', LET_GO, 0.5)
    assert not play.say('a', HELD, 0.6)
    assert play.sent[-1] == HELD


def test_during_a_stop_no_stick_comes_between():
    """A single message that shows the button as let go would end its being pressed."""
    play = Lockplay()
    play.say('a', STOP, 0.0)
    play.say('b', HELD, 0.01)
    assert play.sent == []
    assert play.wait(0.02, 0.1)[0] == STOP


@pytest.mark.parametrize(
    'pad',
    [PadState(reset=True), PadState(robot=1), PadState(release=True), PadState(formation=True)],
)
def test_reset_and_choice_need_the_control_too(pad):
    play = Lockplay()
    play.say('a', HELD, 0.0)
    assert play.say('b', pad, 0.05)
    alone = Lockplay()
    assert not alone.say('b', pad, 0.05)
    assert alone.sent == [pad]


# --- the door ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ('host', 'local'),
    [
        *(('127.0.0.1', True), ('localhost', True), ('::1', True), ('127.8.8.8', True)),
        *(('0.0.0.0', False), ('::', False), ('192.168.1.7', False), ('', False)),
        *(('localhost.evil.org', False), ('127.0.0.1.evil.org', False)),
    ],
)
def test_only_addresses_of_this_machine_are_loopback(host, local):
    assert is_loopback(host) is local


def test_who_opens_the_page_to_others_gets_a_token_that_cannot_be_guessed():
    doors = [make_door('0.0.0.0', 8080, '') for _ in range(2)]
    assert doors[0].token != doors[1].token
    assert len(doors[0].token) >= 32
    assert not doors[0].admits({}, {})
    assert not doors[0].admits({doors[0].cookie: doors[1].token}, {'token': 'ü'})
    assert doors[0].admits({}, {'token': doors[0].token})
    assert doors[0].admits({doors[0].cookie: doors[0].token}, {})
    assert make_door('127.0.0.1', 8080, '').admits({}, {})


def test_a_token_that_is_given_is_wanted_on_this_machine_too():
    door = make_door('127.0.0.1', 8080, 'a-token-of-my-own')
    assert not door.admits({}, {'token': ''})
    assert door.admits({}, {'token': 'a-token-of-my-own'})


def test_a_short_token_is_refused_in_one_line():
    with pytest.raises(ParameterError, match=r'--token has 5 characters; give 16 or more'):
        make_door('0.0.0.0', 8080, '12345')


@pytest.mark.parametrize(
    ('host', 'ours'),
    [
        *(('127.0.0.1:8080', True), ('localhost:9000', True), ('[::1]:8080', True), ('', False)),
        *(('evil.org', False), ('evil.org:8080', False), ('192.168.1.7:8080', False)),
    ],
)
def test_a_name_that_was_made_to_point_at_this_machine_is_not_it(host, ours):
    """DNS rebinding: the browser believes that it talks to evil.org, and says so."""
    assert make_door('127.0.0.1', 8080, '').is_for_us(host) is ours


@pytest.mark.parametrize(
    ('origin', 'ours'),
    [
        *(('http://127.0.0.1:8080', True), ('https://127.0.0.1:8080', True)),
        *(('http://127.0.0.1:8081', False), ('http://evil.org', False), ('null', False)),
        ('', False),
    ],
)
def test_only_our_own_page_may_act(origin, ours):
    door = make_door('127.0.0.1', 8080, '')
    assert door.is_same_site(origin, '127.0.0.1:8080') is ours


def test_a_port_in_use_is_named_with_the_remedy():
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ParameterError, match=rf'--port {port} is in use.*--port 0'):
            listen('127.0.0.1', port)


@pytest.mark.parametrize('host', ['192.0.2.1', 'no-such-host.invalid'])
def test_an_address_that_is_not_ours_is_named(host):
    with pytest.raises(ParameterError, match=rf'--host {host}: .*give an address'):
        listen(host, 0)


def test_the_options_survive_being_handed_on():
    parser = argparse.ArgumentParser()
    add_front_options(parser)
    options = FrontOptions('0.0.0.0', 9000, 'a-token-of-my-own')
    assert FrontOptions(**vars(parser.parse_args(options.arguments()))) == options
    assert FrontOptions(**vars(parser.parse_args([]))) == FrontOptions('127.0.0.1', 8080, '')


# --- what pages say and are told ----------------------------------------------------

SAID = {'number': 1, 'answers': 2.0, 'x': 0.5, 'y': -0.25, 'yaw': 0.1, 'enable': True}
ROBOTS = ('a1_0', 'a1_1')


def test_a_page_s_stick_is_the_pad_s():
    message = read_page_message(json.dumps(SAID | {'choose': 'a1_1', 'turbo': True}), ROBOTS)
    assert message.pad == PadState(x=0.5, y=-0.25, yaw=0.1, enable=True, turbo=True, robot=1)
    assert (message.number, message.answers) == (1, 2.0)


@pytest.mark.parametrize(
    ('choice', 'field'),
    [('*all', 'select_all'), ('*formation', 'formation'), ('*release', 'release')],
)
def test_a_page_may_choose_the_team(choice, field):
    pad = read_page_message(json.dumps(SAID | {'choose': choice}), ROBOTS).pad
    assert getattr(pad, field) is True
    assert pad.robot is None


def test_a_stick_beyond_its_rim_counts_as_at_the_rim():
    pad = read_page_message(json.dumps(SAID | {'x': 7.0, 'y': -7}), ROBOTS).pad
    assert (pad.x, pad.y) == (1.0, -1.0)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'choose': 'a1_9'}, r"no robot 'a1_9'; the robots are: a1_0, a1_1"),
        ({'choose': 3}, 'no robot 3'),
        ({'x': math.nan}, "'x': nan; a finite number"),
        ({'x': '1'}, "'x': '1'"),
        ({'yaw': True}, "'yaw': True"),
        ({'enable': 1}, "'enable': 1; true or false"),
        ({'answers': None}, "'answers': None"),
    ],
)
def test_what_a_page_may_not_say_is_named(changes, words):
    with pytest.raises(MessageError, match=words):
        read_page_message(json.dumps(SAID | changes), ROBOTS)


@pytest.mark.parametrize('text', ['', '[', '[]', '7', 'null'])
def test_noise_is_refused(text):
    with pytest.raises(MessageError, match='JSON'):
        read_page_message(text, ROBOTS)


def test_a_page_is_told_speed_and_the_nearest_neighbour_s_h():
    """0.3 and -0.4 m/s are 0.5 m/s; of two pairs the smaller h counts."""
    told = figures_of(FakeTeam().sight())
    first, second = told['robots']
    assert (first['speed'], first['h'], first['other']) == (0.5, 0.42, 'a1_1')
    assert (second['h'], second['other']) == (0.05, 'cart')
    assert (first['steered'], second['steered']) == (True, False)


def test_a_figure_that_does_not_exist_is_told_as_none():
    """JSON has no infinity: a browser would refuse the whole message."""
    sight = replace(FakeTeam(names=('a1_0',)).sight(), barriers=())
    assert figures_of(sight)['robots'][0]['h'] is None
    json.dumps(figures_of(sight), allow_nan=False)
    assert figures_of(None)['time'] is None


# --- over real sockets ---------------------------------------------------------------


class WirePage:
    """A page without a browser: says what it is told to over a real websocket."""

    def __init__(self, session, address):
        self._session, self._address, self._number = session, address, 0
        self.socket = None
        self.beat = {'beat': -1.0}
        self.words = []

    async def open(self):
        url = f'{self._address}operator'
        headers = {'Origin': self._address.rstrip('/')}
        self.socket = await self._session.ws_connect(url, headers=headers)
        self._reading = asyncio.create_task(self._read())
        await asyncio.sleep(0.15)
        return self

    async def _read(self):
        async for message in self.socket:
            self.beat |= json.loads(message.data)
            self.words.append(self.beat.pop('word', ''))

    async def hold(self, seconds, answers=None, **held):
        """Say thirty times a second what is held."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._number += 1
            heard = self.beat['beat'] if answers is None else answers
            said = {'number': self._number, 'answers': heard, 'x': 0.0, 'y': 0.0, 'yaw': 0.0}
            await self.socket.send_str(json.dumps(said | held))
            await asyncio.sleep(1.0 / 30.0)


def with_pages(play, count=1, **options):
    """Play with so many pages of one front; return the team."""

    async def played(front):
        async with aiohttp.ClientSession() as session:
            pages = [await WirePage(session, front.address).open() for _ in range(count)]
            await play(team, *pages)

    with fake_front(**options) as (front, team):
        asyncio.run(played(front))
    return team


def test_a_stick_that_is_held_is_sent_on_and_its_end_too():
    async def play(team, page):
        await page.hold(0.3, x=0.5, enable=True)
        await page.hold(0.3)

    pads = [pad for _, pad in with_pages(play).pads]
    assert pads[0] == PadState(x=0.5, enable=True)
    assert pads[-1] == PadState()
    held = [pad.enable for pad in pads]
    assert held == sorted(held, reverse=True)  # once let go, it stays so


def test_a_page_that_falls_silent_with_the_stick_in_hand_is_let_go():
    async def play(team, page):
        await page.hold(0.2, x=1.0, enable=True)
        await asyncio.sleep(0.8)
        assert team.last == PadState()
        count = len(team.pads)
        await asyncio.sleep(0.3)
        assert len(team.pads) == count  # then nothing more is said for it

    with_pages(play)


def test_a_page_whose_connection_breaks_is_let_go_and_the_other_may_steer():
    async def play(team, first, second):
        await first.hold(0.2, x=1.0, enable=True)
        await second.hold(0.1, x=-1.0, enable=True)
        assert team.last.x == 1.0
        assert any('is steered from another page' in word for word in second.words)
        first.socket._response.connection.transport.abort()
        await asyncio.sleep(0.1)
        assert not team.last.enable
        await second.hold(0.2, x=-1.0, enable=True)
        assert team.last.x == -1.0

    with_pages(play, count=2)


def test_what_was_held_a_while_ago_moves_nobody_but_an_old_stop_stops():
    """Messages that a stalled network delivers late answer to beats of long ago."""

    async def play(team, page):
        old = page.beat['beat'] - 1.0
        await page.hold(0.2, answers=old, x=1.0, enable=True)
        assert team.pads == []
        assert any('too slow' in word for word in page.words)
        await page.hold(0.1, answers=page.beat['beat'] + 1e6, x=1.0, enable=True)
        assert team.pads == []
        await page.hold(0.1, answers=old, e_stop=True)
        assert team.last.e_stop

    with_pages(play)


def test_a_page_without_the_control_can_stop():
    async def play(team, first, second):
        await first.hold(0.2, x=1.0, enable=True)
        await second.hold(0.05, e_stop=True)
        await first.hold(0.4, x=1.0, enable=True)
        stop = next(i for i, (_, pad) in enumerate(team.pads) if pad.e_stop)
        assert not any(pad.enable for _, pad in team.pads[stop:])
        assert any('let go of the stick' in word for word in first.words)

    with_pages(play, count=2)


def test_a_robot_that_nobody_knows_is_refused_by_name():
    async def play(team, page):
        await page.hold(0.1, choose='a1_9')
        assert team.pads == []
        assert any("no robot 'a1_9'" in word for word in page.words)

    with_pages(play)


def fetch(url, method='GET', **headers):
    """Return status, text and headers of an answer."""

    async def ask():
        async with (
            aiohttp.ClientSession() as session,
            session.request(method, url, headers=headers) as answer,
        ):
            return answer.status, await answer.text(), answer.headers

    return asyncio.run(ask())


UPGRADE = {
    'Upgrade': 'websocket',
    'Connection': 'Upgrade',
    'Sec-WebSocket-Version': '13',
    'Sec-WebSocket-Key': 'MDEyMzQ1Njc4OWFiY2RlZg==',
}


@pytest.mark.parametrize('path', ['', 'operator', 'view/', 'view', 'page/page.js', 'nothing'])
def test_without_the_token_there_is_nothing_to_be_had(path):
    with fake_front(token='a-token-of-my-own') as (front, _):
        address = front.address.partition('?')[0]
        origin = {'Origin': address.rstrip('/')}
        for headers in ({}, origin, UPGRADE | origin, {'Cookie': 'layered_cbf_0=x'}):
            status, text, _ = fetch(address + path, **headers)
            assert (status, 'token' in text) == (401, True)
        assert fetch(address + 'e_stop', 'POST', **origin)[0] == 401


def test_the_token_becomes_a_cookie_that_no_script_reads_and_no_other_site_sends():
    with fake_front(token='a-token-of-my-own') as (front, _):
        status, _, headers = fetch(front.address)
        assert status == 200
        cookie = headers['Set-Cookie']
        assert 'HttpOnly' in cookie
        assert 'SameSite=Strict' in cookie
        again = fetch(front.address.partition('?')[0], Cookie=cookie.partition(';')[0])
        assert again[0] == 200


def test_pages_of_other_sites_can_not_act():
    with fake_front() as (front, team):
        for origin in ('http://evil.org', 'null', 'http://127.0.0.1:1'):
            for path in ('operator', 'view'):
                assert fetch(front.address + path, **UPGRADE, Origin=origin)[0] == 403
            assert fetch(front.address + 'e_stop', 'POST', Origin=origin)[0] == 403
        assert fetch(front.address, Host='evil.org')[0] == 403
        assert team.pads == []
        assert "frame-ancestors 'self'" in fetch(front.address)[2]['Content-Security-Policy']


def test_our_own_page_can_stop_without_its_websocket():
    with fake_front() as (front, team):
        fetch(front.address + 'e_stop', 'POST', Origin=front.address.rstrip('/'))
        until(lambda: team.pads and team.pads[0][1].e_stop)


def test_the_scene_comes_through_our_door():
    async def play(address):
        async with aiohttp.ClientSession(headers={'Origin': address.rstrip('/')}) as session:
            async with session.get(f'{address}view/some/file?x=1') as answer:
                text = await answer.text()
            async with session.ws_connect(f'{address}view', protocols=('viser-v9',)) as joined:
                await joined.send_bytes(b'abc')
                turned = await joined.receive_bytes()
                await joined.send_str('hello')
                return text, turned, await joined.receive_str()

    with fake_front() as (front, _):
        text, turned, echo = asyncio.run(play(front.address))
    assert 'scene /some/file' in text
    assert turned == b'cba'
    assert echo == 'viser-v9: hello'


def test_a_front_that_closes_lets_go():
    async def play(team, page):
        await page.hold(0.2, x=1.0, enable=True)

    assert with_pages(play).last == PadState()
