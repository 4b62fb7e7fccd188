"""A driver hears its own robot, the newest first, and nobody else."""

import socket
import time
from dataclasses import replace

import numpy as np
import pytest

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.plants.a1.frames import SERVO, LowCommand, LowState
from layered_cbf_ros.plants.a1.link import BEGUN_ANEW, MOST_PACKETS, Link, TickOrder
from layered_cbf_ros.plants.a1.packets import CommandPacker, pack_state, unpack_command
from layered_cbf_ros.plants.a1.peer import Peer

LOOPBACK = '127.0.0.1'
STANDING = LowState(
    0,
    np.full(12, SERVO),
    np.zeros(12),
    np.zeros(12),
    np.zeros(12),
    np.full(12, 30),
    np.array([0.0, 0.0, 0.0, 1.0]),
    np.zeros(3),
    np.array([0.0, 0.0, 9.81]),
    np.full(4, 30.0),
    bytes(40),
)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind((LOOPBACK, 0))
        return trial.getsockname()[1]


class Wire:
    """A link and its robot, over real UDP."""

    def __init__(self):
        port, self.local = free_port(), free_port()
        self.robot = Peer(LOOPBACK, port)
        self.link = Link(LOOPBACK, port, self.local)

    def tell(self, packet):
        self.robot.send(packet, (LOOPBACK, self.local))

    def told(self, tick, **changes):
        self.tell(pack_state(replace(STANDING, tick=tick, **changes)))

    def heard(self, packets=1):
        """Return the newest state, once so many packets have come, good or bad."""
        before, newest = self.count(), None
        end = time.monotonic() + 5.0
        while self.count() < before + packets and time.monotonic() < end:
            newest = self.link.receive() or newest
        return newest

    def count(self):
        return self.link.received + sum(self.link.refused.values())


@pytest.fixture
def wire():
    wire = Wire()
    yield wire
    wire.link.close()
    wire.robot.close()


def test_of_all_that_wait_the_newest_is_taken(wire):
    for tick in (1, 2, 3):
        wire.told(tick)
    time.sleep(0.05)
    assert wire.link.receive().tick == 3
    assert wire.link.received == 3
    assert wire.link.receive() is None


def test_a_robot_hears_what_its_driver_says(wire):
    wire.link.send(CommandPacker(33.5).pack(LowCommand.damping(2.0)))
    end, packets = time.monotonic() + 5.0, []
    while not packets and time.monotonic() < end:
        packets = wire.robot.receive()
    ((packet, sender),) = packets
    assert sender[1] == wire.local
    assert (unpack_command(packet).kd == 2.0).all()


def test_a_stranger_is_ignored_and_counted(wire):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(pack_state(replace(STANDING, tick=9)), (LOOPBACK, wire.local))
        assert wire.heard() is None
    assert wire.link.refused == {'address': 1}
    wire.told(1)
    assert wire.heard().tick == 1  # its clock was not believed


def test_spoilt_short_and_empty_packets_are_refused_by_kind(wire):
    good = pack_state(replace(STANDING, tick=1))
    for packet in (good[:-1], good + b'x', good[:100] + b'?' + good[101:], b''):
        wire.tell(packet)
    assert wire.heard(4) is None
    assert wire.link.refused == {'length': 3, 'checksum': 1}


def test_what_comes_twice_or_late_is_refused(wire):
    wire.told(10)
    assert wire.heard().tick == 10
    wire.told(10)
    wire.told(9)
    assert wire.heard(2) is None
    assert wire.link.refused == {'replayed': 1, 'older': 1}


def test_a_clock_that_stands_still_is_no_replay(wire):
    """Its unit isn't known: two states of one tick may differ."""
    wire.told(10)
    wire.heard()
    wire.told(10, foot_force=np.full(4, 31.0))
    assert wire.heard().foot_force[0] == 31.0


def test_a_clock_may_go_round():
    order = TickOrder()
    assert order.accepts(2**32 - 2)
    assert order.accepts(3)
    assert not order.accepts(2**32 - 1)


def test_a_robot_that_was_restarted_is_believed_after_a_while_and_old_frames_never():
    order = TickOrder()
    assert order.accepts(1_000_000)
    assert [order.accepts(tick) for tick in range(BEGUN_ANEW)].count(True) == 1
    assert order.accepts(BEGUN_ANEW)
    order = TickOrder()
    assert order.accepts(1_000_000)
    assert any(order.accepts(tick // 3) for tick in range(4 * BEGUN_ANEW))  # a coarse clock
    order = TickOrder()
    assert order.accepts(1_000_000)
    assert not any(order.accepts(7) for _ in range(3 * BEGUN_ANEW))  # one frame, again and again
    order = TickOrder()
    assert order.accepts(1_000_000)
    assert not any(order.accepts(tick) for tick in [7, 8, 9, 8] * BEGUN_ANEW)


def test_a_flood_takes_turns_with_the_robot(wire):
    """One call ends however much waits; the robot is heard when its turn comes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(MOST_PACKETS + 10):
            stranger.sendto(b'?', (LOOPBACK, wire.local))
    wire.told(1)
    time.sleep(0.05)
    assert wire.link.receive() is None
    assert wire.link.refused == {'address': MOST_PACKETS}
    assert wire.link.receive().tick == 1


def test_an_address_that_is_not_ours_is_named():
    with pytest.raises(LayeredCbfError, match=r"emulation.port 8007: .*192.0.2.1 can't be had"):
        Peer('192.0.2.1', 8007)


def test_a_port_that_somebody_has_is_named(wire):
    with pytest.raises(LayeredCbfError, match=f'local_port {wire.local}: .*not free'):
        Link(LOOPBACK, 8007, wire.local)
