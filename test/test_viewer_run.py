"""A person at a real page drives, stops and loses a real simulated A1."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

import rclpy
from browser import LAPTOP, PHONE, chromium
from live_node import DOMAIN
from live_run import LiveRun
from nav_msgs.msg import Odometry
from PIL import Image
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from layered_cbf_ros.robot_model import FALLEN_HEIGHT
from layered_cbf_ros.viewing.sight.bag_sight import BagSight

pytestmark = pytest.mark.system

STORE = get_typestore(Stores.ROS2_JAZZY)
LIMIT_S = 90.0
WORLD = """\
description: One A1 that wants nothing, and a post beside it.
duration: 120.0
robots:
  - {name: a1_0, position: [0.0, 0.0]}
obstacles:
  - {name: post, radius: 0.3, motion: {standing: {position: [0.0, 3.0]}}}
"""


class Odometer:
    """Hears where the robot is, by a subscription of the test's own."""

    def __init__(self):
        os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self._node = Node('odometer', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.x = self.height = self.speed = float('nan')
        self._node.create_subscription(Odometry, '/a1_0/odom', self._take, 10)

    def _take(self, message):
        self.x, self.height = message.pose.pose.position.x, message.pose.pose.position.z
        self.speed = message.twist.twist.linear.x

    def until(self, condition, page, act=lambda: None):
        """Listen, let the page live, and act once a second, until something is true."""
        end, next_act = time.monotonic() + LIMIT_S, 0.0
        while not condition():
            assert time.monotonic() < end, (self.x, self.height, self.speed)
            if time.monotonic() > next_act:
                act()
                next_act = time.monotonic() + 1.0
            page.wait_for_timeout(20)
            for _ in range(20):
                self._executor.spin_once(timeout_sec=0.0)

    def end(self):
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


class Steered:
    """A run with its page; what it prints is read all the time."""

    def __init__(self, folder):
        world = folder / 'world.yaml'
        world.write_text(WORLD)
        self.run = LiveRun(world, folder / 'run', '--viewer', '--page-port', '0')
        self._lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.run.process.stdout:
            self._lines.append(line)

    def address(self):
        """Return the address that the run prints for its page."""
        end = time.monotonic() + LIMIT_S
        while time.monotonic() < end:
            for line in list(self._lines):
                if 'http://' in line:
                    return 'http://' + line.partition('http://')[2].strip()
            time.sleep(0.05)
        pytest.fail(''.join(self._lines))

    def end(self):
        """End the run as Ctrl-C does, and return what it said."""
        self.run.process.send_signal(signal.SIGINT)
        self.run.process.wait(LIMIT_S)
        self._reader.join(LIMIT_S)
        return ''.join(self._lines)


def opened(context, address):
    page = context.new_page()
    page.set_default_timeout(60_000)
    page.goto(address)
    page.wait_for_selector('#chips button')
    return page


def push_forward(page):
    """Push the stick, unless it is pushed already: a busy page is refused for a moment."""
    if page.inner_text('#control') == 'You steer':
        return
    page.mouse.up()
    box = page.locator('#stick').bounding_box()
    x, y = box['x'] + box['width'] / 2.0, box['y'] + box['height'] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 300)


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    """Drive, lose the page while driving, drive again, stop all; return the run's folder."""
    folder = tmp_path_factory.mktemp('steered')
    steered, odometer, seen = Steered(folder), Odometer(), {}
    try:
        address = steered.address()
        with chromium() as browser:
            context = browser.new_context(viewport={'width': PHONE[0], 'height': PHONE[1]})
            # The scene is looked at below: drawn without a graphics card it starves the run.
            context.route('**/view/**', lambda route: route.abort())
            page = opened(context, address)
            odometer.until(lambda: odometer.height > 0.2, page)
            seen['start'] = odometer.x
            forward = seen['start'] + 0.15
            odometer.until(lambda: odometer.x > forward, page, lambda: push_forward(page))
            seen['fast'] = odometer.speed
            page.close()
            page = opened(context, address)
            odometer.until(lambda: abs(odometer.speed) < 0.02, page)
            seen['lost'] = odometer.x
            forward = seen['lost'] + 0.15
            odometer.until(lambda: odometer.x > forward, page, lambda: push_forward(page))
            page.keyboard.press('Escape')  # the other hand: the mouse is on the stick
            odometer.until(lambda: odometer.height < FALLEN_HEIGHT, page)
            page.wait_for_selector('#banner:has-text("EMERGENCY STOP")')
    finally:
        odometer.end()
        seen['said'] = steered.end()
    return steered.run, seen


def test_the_stick_drives_the_robot_and_a_dead_page_stops_it(drive):
    _, seen = drive
    assert seen['fast'] > 0.1
    assert seen['lost'] - seen['start'] < 1.0


def test_the_bag_tells_of_the_stop_and_that_nobody_fell(drive):
    run, seen = drive
    summary = run.summary()
    assert summary['outcome'] == 'stopped', seen['said']
    assert (summary['falls'], summary['contacts']) == (0, 0)
    assert summary['rejected'] == 0
    assert summary['e_stops'] == 1


def test_what_is_seen_of_a_bag_is_what_was_recorded(drive):
    """The oracle is an independent reader's decoding of joint states and odometry."""
    run, _ = drive
    sight = BagSight(run.output / 'bag')
    with AnyReader([run.output / 'bag'], default_typestore=STORE) as reader:
        found = {}
        for topic in ('/a1_0/joint_states', '/a1_0/odom'):
            connections = [c for c in reader.connections if c.topic == topic]
            for connection, _, data in reader.messages(connections):
                message = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp
                found[topic, stamp.sec * 10**9 + stamp.nanosec] = message
    stamps = sorted(stamp for topic, stamp in found if topic == '/a1_0/odom')
    for stamp in stamps[:: max(1, len(stamps) // 20)]:
        robot = sight.at((stamp - stamps[0]) / 1e9).robots[0]
        pose = found['/a1_0/odom', stamp].pose.pose
        place = [pose.position.x, pose.position.y, pose.position.z]
        assert robot.configuration[:3] == pytest.approx(place, abs=1e-9)
        assert robot.configuration[7:] == pytest.approx(
            np.array(found['/a1_0/joint_states', stamp].position), abs=1e-9
        )
    names = [moment.name for moment in sight.moments]
    assert 'emergency stop' in names


def test_the_page_of_a_bag_shows_it_in_3d_and_jumps_to_what_happened(drive, tmp_path):
    """Seen by the pixels of a real browser: the picture is no blank, and changes with the jump."""
    run, _ = drive
    program = 'from layered_cbf_ros.nodes.viewer import main; main()'
    viewer = subprocess.Popen(
        [sys.executable, '-c', program, str(run.output), '--port', '0'],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        address = viewer.stdout.readline().partition('viewer: ')[2].strip()
        with chromium() as browser:
            page = browser.new_page(viewport={'width': LAPTOP[0], 'height': LAPTOP[1]})
            page.set_default_timeout(60_000)
            page.goto(address)
            scene = page.frame_locator('#scene')
            scene.get_by_text('emergency stop').first.wait_for()
            page.wait_for_timeout(3000)
            before = picture(page, tmp_path / 'start.png')
            assert before.std() > 5.0
            scene.get_by_text('emergency stop').first.click()
            page.wait_for_timeout(3000)
            assert scene.get_by_text('0.00 s', exact=True).count() == 0
            after = picture(page, tmp_path / 'stop.png')
            assert np.abs(after - before).max() > 50.0
    finally:
        viewer.send_signal(signal.SIGINT)
        assert viewer.wait(LIMIT_S) == 0


def picture(page, path):
    """Return what is seen, in shades of grey."""
    page.screenshot(path=path)
    with Image.open(path) as image:
        return np.asarray(image.convert('L'), dtype=float)
