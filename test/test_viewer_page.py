"""The page in a real Chromium: a finger, a key, a reload or a crash does what people expect."""

from __future__ import annotations

import contextlib
import re
import time

import pytest
from browser import LAPTOP, PHONE, chromium, fake_front, until
from playwright.sync_api import Error

from layered_cbf_ros.operation.virtual_pad import PadState


@pytest.fixture(scope='module')
def browser():
    with chromium() as started:
        yield started


@pytest.fixture
def team_and_open(browser):
    """Yield the made-up team, and a function that opens a page of its front."""
    contexts = []

    def open_page(size=LAPTOP, touch=False):
        viewport = {'width': size[0], 'height': size[1]}
        context = browser.new_context(viewport=viewport, has_touch=touch)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(20_000)
        page.goto(front.address)
        page.wait_for_selector('#chips button')
        return page

    with fake_front() as (front, team):
        yield team, open_page
        for context in contexts:
            context.close()


def middle(page, selector):
    box = page.locator(selector).bounding_box()
    return box['x'] + box['width'] / 2.0, box['y'] + box['height'] / 2.0


def push(page, selector, across, down):
    """Press the mouse on the middle of something, and move it so many pixels."""
    x, y = middle(page, selector)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + across, y + down)


def held_now(team, page, condition):
    """Wait until the pad is as wanted."""
    until(lambda: team.pads and condition(team.last), page)


@pytest.mark.parametrize(
    ('selector', 'across', 'down', 'wanted'),
    [
        ('#stick', 0, -300, (1.0, 0.0, 0.0)),
        ('#stick', 0, 100, (-1.0, 0.0, 0.0)),
        ('#stick', -100, 0, (0.0, 1.0, 0.0)),
        ('#stick', 100, 0, (0.0, -1.0, 0.0)),
        ('#yaw', -150, 0, (0.0, 0.0, 1.0)),
        ('#yaw', 150, 0, (0.0, 0.0, -1.0)),
    ],
)
def test_a_pushed_stick_is_a_velocity_and_a_lifted_finger_is_none(
    team_and_open, selector, across, down, wanted
):
    """Up is forward, left is left, and left turns left: as REP-103 counts them."""
    team, open_page = team_and_open
    page = open_page()
    push(page, selector, across, down)
    held_now(
        team,
        page,
        lambda pad: pad.enable and (pad.x, pad.y, pad.yaw) == pytest.approx(wanted, abs=1e-6),
    )
    page.mouse.up()
    held_now(team, page, lambda pad: pad == PadState())


def test_two_fingers_drive_and_turn_and_each_may_be_lifted_alone(team_and_open):
    team, open_page = team_and_open
    page = open_page(PHONE, touch=True)
    fingers = page.context.new_cdp_session(page)
    (x, y), (turn_x, turn_y) = middle(page, '#stick'), middle(page, '#yaw')

    def touch(kind, *points):
        at = [{'x': px, 'y': py, 'id': name} for name, px, py in points]
        fingers.send('Input.dispatchTouchEvent', {'type': kind, 'touchPoints': at})

    touch('touchStart', (0, x, y))
    touch('touchStart', (0, x, y), (1, turn_x, turn_y))
    touch('touchMove', (0, x, y - 200), (1, turn_x - 150, turn_y))
    held_now(team, page, lambda pad: pad.enable and pad.x > 0.99 and pad.yaw > 0.99)
    touch('touchEnd', (1, turn_x - 150, turn_y))
    held_now(team, page, lambda pad: pad.enable and pad.x > 0.99 and pad.yaw == 0.0)
    touch('touchEnd')
    held_now(team, page, lambda pad: pad == PadState())


def test_keys_that_are_held_drive_and_space_stops(team_and_open):
    team, open_page = team_and_open
    page = open_page()
    page.keyboard.down('w')
    page.keyboard.down('q')
    held_now(team, page, lambda pad: pad.enable and (pad.x, pad.yaw) == (1.0, 1.0))
    page.keyboard.up('q')
    page.keyboard.down('Shift')
    held_now(team, page, lambda pad: pad.turbo and pad.yaw == 0.0)
    page.keyboard.press('Space')
    held_now(team, page, lambda pad: pad.e_stop and not pad.enable)
    team.pads.clear()
    page.wait_for_timeout(600)  # w is still down, but was not pressed anew
    assert not any(pad.enable for _, pad in team.pads)


@pytest.mark.parametrize('how', ['button', 'escape', 'escape in the scene'])
def test_everybody_is_stopped(team_and_open, how):
    team, open_page = team_and_open
    page = open_page()
    if how == 'button':
        page.click('#stop')
    elif how == 'escape':
        page.keyboard.press('Escape')
    else:
        page.frame_locator('#scene').locator('#text').click()
        page.keyboard.press('Escape')
    until(lambda: team.stopped, page)
    page.wait_for_selector('#banner:has-text("EMERGENCY STOP")')
    assert page.is_visible('#reset')


def test_the_stop_ends_by_a_button_that_is_held_alone_for_a_second(team_and_open):
    team, open_page = team_and_open
    page = open_page()
    page.click('#stop')
    page.wait_for_selector('#reset', state='visible')
    push(page, '#reset', 0, 0)
    page.wait_for_timeout(1500)
    page.mouse.up()
    held_now(team, page, lambda pad: not pad.reset)
    times = [at for at, pad in team.pads if pad.reset]
    assert not any(pad.enable or pad.e_stop for _, pad in team.pads if pad.reset)
    assert times[-1] - times[0] > 1.0


def test_only_one_page_steers_and_the_other_is_told(team_and_open):
    team, open_page = team_and_open
    first, second = open_page(), open_page()
    push(first, '#stick', 0, -100)
    held_now(team, first, lambda pad: pad.x == 1.0)
    push(second, '#stick', 0, 100)
    second.wait_for_selector('#word:has-text("a1_0 is steered from another page")')
    assert second.inner_text('#control') == 'Another page steers'
    assert team.last.x == 1.0
    first.mouse.up()
    held_now(team, second, lambda pad: pad.x == -1.0)
    second.mouse.up()


def test_chips_choose_robots_by_name(team_and_open):
    team, open_page = team_and_open
    page = open_page()
    page.click('#chips button:text-is("a1_1")')
    until(lambda: any(pad.robot == 1 for _, pad in team.pads), page)
    page.click('#chips button:text-is("formation")')
    until(lambda: any(pad.formation for _, pad in team.pads), page)
    page.click('#chips button:text-is("give back")')
    until(lambda: any(pad.release for _, pad in team.pads), page)
    assert page.get_attribute('#chips button:text-is("a1_0")', 'aria-pressed') == 'true'


def test_the_figures_are_those_of_the_robot_that_is_steered(team_and_open):
    _, open_page = team_and_open
    page = open_page()
    assert [page.inner_text(f'#{name}') for name in ('speed', 'h', 'intervention')] == [
        '0.50',
        '0.42',
        '0.12',
    ]
    assert page.inner_text('#other') == 'm to a1_1'


def renderer_dies(page):
    with contextlib.suppress(Error):
        page.goto('chrome://crash')


def freeze(page):
    page.evaluate('setTimeout(() => { const end = Date.now() + 1500; while (Date.now() < end); })')


def blur(page):
    page.evaluate('dispatchEvent(new Event("blur"))')


@pytest.mark.parametrize(
    'end',
    [lambda page: page.close(), lambda page: page.reload(), renderer_dies, freeze, blur],
    ids=['closed', 'reloaded', 'crashed', 'frozen', 'left'],
)
def test_a_page_that_ends_while_it_steers_has_let_go(team_and_open, end):
    team, open_page = team_and_open
    watcher, page = open_page(), open_page()
    push(page, '#stick', 0, -100)
    held_now(team, page, lambda pad: pad.x == 1.0)
    end(page)
    held_now(team, watcher, lambda pad: pad == PadState())


def test_a_page_that_was_reloaded_in_the_middle_of_steering_can_steer_again(team_and_open):
    team, open_page = team_and_open
    page = open_page()
    push(page, '#stick', 0, -100)
    held_now(team, page, lambda pad: pad.x == 1.0)
    page.reload()
    held_now(team, page, lambda pad: pad == PadState())
    page.wait_for_selector('#chips button')
    page.mouse.up()
    push(page, '#stick', 0, 100)
    held_now(team, page, lambda pad: pad.x == -1.0)


@pytest.mark.parametrize(('size', 'touch'), [(LAPTOP, False), (PHONE, True)])
def test_whatever_a_person_needs_is_on_the_screen_and_uncovered(team_and_open, size, touch):
    team, open_page = team_and_open
    page = open_page(size, touch)
    team.stopped = True
    page.wait_for_selector('#reset', state='visible')
    for selector in ('#stop', '#reset', '#stick', '#yaw', '#turbo', '#speed', '#control'):
        x, y = middle(page, selector)
        found = page.evaluate(
            '([selector, x, y]) => document.elementFromPoint(x, y)?.closest(selector) !== null',
            [selector, x, y],
        )
        assert found, f'{selector} is covered, or not on the screen'
        box = page.locator(selector).bounding_box()
        assert box['x'] >= 0.0
        assert box['y'] >= 0.0
        assert box['x'] + box['width'] <= size[0]
        assert box['y'] + box['height'] <= size[1]
    assert page.locator('#scene').bounding_box()['height'] > 0.4 * size[1]


def test_the_token_opens_the_page_once_and_is_not_seen_again(browser):
    with fake_front(token='a-token-of-my-own') as (front, team):
        context = browser.new_context()
        page = context.new_page()
        address = front.address.partition('?')[0]
        assert page.goto(address).status == 401
        page.goto(front.address)
        page.wait_for_selector('#chips button')
        assert page.url == address
        assert page.evaluate('document.cookie') == ''
        assert 'scene' in page.frame_locator('#scene').locator('p').inner_text()
        page.reload()
        page.wait_for_selector('#chips button')
        page.click('#stop')
        until(lambda: team.stopped, page)
        context.close()


def test_a_page_of_another_site_can_neither_stop_nor_steer_nor_frame_ours(browser):
    """The browser itself tells where a page comes from; it can't be made to lie."""
    with fake_front() as (victim, team), fake_front() as (other, _):
        context = browser.new_context()
        page = context.new_page()
        page.goto(other.address.replace('127.0.0.1', 'localhost') + 'view/')  # a page with no rules
        tried = page.evaluate(
            """async (address) => {
              await fetch(address + 'e_stop', {method: 'POST', mode: 'no-cors'}).catch(() => 0);
              return new Promise((tell) => {
                const socket = new WebSocket(address.replace('http', 'ws') + 'operator');
                socket.onopen = () => tell('open');
                socket.onerror = () => tell('refused');
              });
            }""",
            victim.address,
        )
        assert tried == 'refused'
        time.sleep(0.2)
        assert team.pads == []
        context.close()


def test_a_bag_s_page_has_no_stick(browser):
    from browser import FakeScene, FakeTeam

    from layered_cbf_ros.viewing.front.front import Front
    from layered_cbf_ros.viewing.front.options import FrontOptions

    scene = FakeScene()
    front = Front(FrontOptions(port=0), scene.port, FakeTeam().sight, None)
    page = browser.new_page()
    page.goto(front.address)
    page.wait_for_selector('#panel', state='hidden')
    assert re.match('scene', page.frame_locator('#scene').locator('p').inner_text())
    page.close()
    front.close()
    scene.close()
