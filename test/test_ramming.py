"""A reckless operator rams everything with random sticks: the filter keeps the bodies apart.

Robots follow their plan exactly here; distances are plain arithmetic on places of discs.
"""

import itertools
import math
import random

import numpy as np
import pytest

from layered_cbf_ros.coordination.coordinator import Coordinator
from layered_cbf_ros.coordination.exchange import CoordinationInputs
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import NS_PER_S, Track
from layered_cbf_ros.operation.desk import Desk, Now, heard, stopped
from layered_cbf_ros.operation.joystick import Choice, Hands
from layered_cbf_ros.operation.orders import no_orders, ordered
from layered_cbf_ros.operation.parameters import JoystickParameters
from layered_cbf_ros.scenario import Robot, Wall

PAD = JoystickParameters()
TIMEOUT_NS = round(PAD.joy_timeout * NS_PER_S)
RATE = 250
POST, CART = 0.25, 0.3  # radii [m]
ROBOTS = (Robot('a', (-1.5, 0.0)), Robot('b', (1.5, 0.0), math.pi))
WALLS = (Wall('left', (0.0, 2.0), (0.0, -1.0)), Wall('right', (0.0, -2.0), (0.0, 1.0)))


def tracks(stamp_ns):
    """Return a post that stands, and a cart that goes to and fro between two points."""
    time = stamp_ns / NS_PER_S
    phase = time % 20.0
    x, speed = (-2.5 + 0.25 * phase, 0.25) if phase < 10.0 else (2.5 - 0.25 * (phase - 10), -0.25)
    still, exact = np.zeros(2), np.zeros((4, 4))
    return (
        Track('post', stamp_ns, np.array([0.0, 1.3]), still, exact, POST),
        Track('cart', stamp_ns, np.array([x, -1.5]), np.array([speed, 0.0]), exact, CART),
    )


def gaps(positions, bodies, radius):
    """Return the smallest distance between surfaces of each kind of pair [m]."""
    a, b = positions
    walls = min((2.0 - abs(y)) - radius for _, y in positions)
    post, cart = bodies
    return {
        'robots': math.dist(a, b) - 2.0 * radius,
        'walls': walls,
        'post': min(math.dist(p, post.position) for p in positions) - radius - POST,
        'cart': min(math.dist(p, cart.position) for p in positions) - radius - CART,
    }


def ram(seed, seconds=16.0):
    """Return the smallest gaps of a drive with random sticks, and how hard the filter worked."""
    rng = random.Random(seed)
    p = CoordinatorParameters()
    coordinator = Coordinator(p, ROBOTS, WALLS, RATE)
    state, desk, orders = coordinator.start(0), Desk(), no_orders(0, 2)
    period_ns = NS_PER_S // RATE
    smallest, work = {}, 0.0
    hands = Hands()
    for tick in range(round(seconds * RATE)):
        now = Now(tick * period_ns, tick * period_ns)
        if tick % (2 * RATE) == 0:
            angle = rng.uniform(-math.pi, math.pi)
            choice = rng.choice([0, 1, Choice.ALL, Choice.FORMATION])
            turn = rng.uniform(-1.0, 1.0)
            hands = Hands(math.cos(angle), math.sin(angle), turn, enable=True, choice=choice)
        if tick % 10 == 0:
            desk, _ = heard(desk, 'joy', hands, now, 2, TIMEOUT_NS)
        orders = ordered(orders, desk, now, PAD)
        bodies = tracks(now.run_ns)
        for kind, gap in gaps(state.positions, bodies, p.agent_radius).items():
            smallest[kind] = min(smallest.get(kind, math.inf), gap)
        inputs = CoordinationInputs(
            now.run_ns,
            state.positions,
            state.velocities,
            np.zeros(2, dtype=bool),
            bodies,
            orders.commands,
            state.yaws,
        )
        result = coordinator.step(state, inputs)
        work = max(work, float(np.abs(result.u - result.u_desired).max()))
        state = result.state
    return smallest, work


@pytest.mark.parametrize('seed', range(4))
def test_whatever_the_operator_does_no_two_bodies_touch(seed):
    """Speeds and accelerations of the robots exceed the cart's, so they can give way."""
    smallest, work = ram(seed)
    assert work > 0.5, 'nobody was rammed'
    for kind, gap in smallest.items():
        assert gap > 0.05, (kind, gap)


def test_without_the_filter_the_same_sticks_do_hit_something(monkeypatch):
    """So the drives above are a trial, and not a walk in the park."""
    plain = Coordinator.__init__
    monkeypatch.setattr(Coordinator, '__init__', lambda self, *a: plain(self, *a, filtered=False))
    worst = [min(ram(seed)[0].values()) for seed in range(4)]
    assert sum(gap < 0.0 for gap in worst) >= 3, worst


def test_the_emergency_stop_brings_robots_to_rest_on_their_own_line():
    """v' = -v / T, at most the largest acceleration: they brake straight, without a swerve."""
    p = CoordinatorParameters()
    coordinator = Coordinator(p, ROBOTS[:1], ())
    state, desk, orders = coordinator.start(0), Desk(), no_orders(0, 1)
    desk, _ = heard(desk, 'joy', Hands(0.5, 0.2, enable=True), Now(0, 0), 1, TIMEOUT_NS)
    speeds, places = [], []
    for tick in range(5000):
        now = Now(tick * 1_000_000, 0)
        desk = stopped(desk) if tick == 3000 else desk
        orders = ordered(orders, desk, now, PAD)
        inputs = CoordinationInputs(
            now.run_ns,
            state.positions,
            state.velocities,
            np.zeros(1, dtype=bool),
            (),
            orders.commands,
            state.yaws,
            orders.stopped,
        )
        state = coordinator.step(state, inputs).state
        speeds.append(float(np.hypot(*state.velocities[0])))
        places.append(state.positions[0])
    braking = speeds[3000:]
    assert braking[0] > 0.45
    assert all(b <= a + 1e-9 for a, b in itertools.pairwise(braking))
    assert braking[1000] < 0.03
    assert float(np.hypot(*(places[-1] - places[3000]))) < 0.5 * 0.5
    assert state.sitting[0] > 0.0
