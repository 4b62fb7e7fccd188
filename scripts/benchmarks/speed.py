"""Speed of the parts: processor time of one call, warm, in one thread.

Beside each figure stands its ratio to a fixed piece of work that was measured at the
same moment: that is what compares between machines, and under load.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import closed_loop
import numpy as np
import test_messages as samples
from closed_loop import ClosedLoop, walk
from test_coordinator import told, track

from benchmarks.row import Row
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.coordination.coordinator import Coordinator
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.interfaces import JOINT_NAMES, Array, GroundForcePlan
from layered_cbf_ros.messages.ground_forces import GroundForceReader, GroundForceWriter
from layered_cbf_ros.messages.joint_state import JointStateReader, JointStateWriter
from layered_cbf_ros.messages.robot_state import StateReader, StateWriter
from layered_cbf_ros.messages.trajectory import TrajectoryReader, TrajectoryWriter
from layered_cbf_ros.perception.obstacle_tracker import ObstacleTracker
from layered_cbf_ros.perception.parameters import ObstacleTrackerParameters
from layered_cbf_ros.plants.bullet_world import BulletWorld
from layered_cbf_ros.plants.parameters import SimulatorParameters
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Desired, Obstacle, Robot, Wall
from layered_cbf_ros.scenario_file import load_scenario
from layered_cbf_ros.whole_body.whole_body_controller import WholeBodyController

US = 1e3  # [ns]
CROSSING_RATE = 50  # [Hz]: few ticks make a whole crossing; one costs what it does at 1 kHz
FOUR = ('a1_0', 'a1_1', 'a1_2', 'a1_3')
SCENARIOS = ('one_agent_three_obstacles', 'four_agents')
STAMPED = 'sensor_msgs/msg/JointState'


def calibration_us() -> float:
    """Return the median time of 100 products of 12 x 12 matrices [us]."""
    matrix, out = np.full((12, 12), 0.1), np.empty((12, 12))

    def work() -> None:
        for _ in range(100):
            np.dot(matrix, matrix, out=out)

    return float(np.median(durations(work, 100, 1))) / US


def durations(call: Callable[[], object], count: int, batch: int = 10) -> list[float]:
    """Return processor times of a call [ns], each the mean of a batch."""
    times = []
    for _ in range(count):
        begun = time.thread_time_ns()
        for _ in range(batch):
            call()
        times.append((time.thread_time_ns() - begun) / batch)
    return times


@contextmanager
def timed(owner: type, method: str) -> Iterator[list[float]]:
    """Note the processor time of each call of a method [ns]."""
    original, times = getattr(owner, method), []

    def measured(*arguments: object) -> object:
        begun = time.thread_time_ns()
        result = original(*arguments)
        times.append(time.thread_time_ns() - begun)
        return result

    setattr(owner, method, measured)
    try:
        yield times
    finally:
        setattr(owner, method, original)


def speed_row(what: str, times: Sequence[float], unit: str = 'us') -> Row:
    """Return the figure of a part; the first tenth warms up."""
    p50, p99 = np.percentile(times[len(times) // 10 :], (50, 99)) / (US if unit == 'us' else 1e6)
    ratio = p50 / calibration_us() * (1.0 if unit == 'us' else 1e3)
    details = {'p99': float(p99), 'calibrations': float(ratio)}
    return Row(what, float(p50), unit, physical=False, details=details)


def calibration_rows() -> list[Row]:
    """Tell how fast this machine is."""
    return [Row('calibration: 100 products of 12 x 12', calibration_us(), 'us', physical=False)]


def coordinator_rows() -> list[Row]:
    """Cross the corridor of both scenarios, and a circle on which everybody changes sides."""
    rows = []
    for name in SCENARIOS:
        world = load_scenario(name)
        times = _crossing(world.robots, world.walls, world.obstacles, 40.0)
        rows.append(speed_row(f'coordinator: {name}', times))
    for count, duration in ((8, 15.0), (16, 6.0)):
        times = _crossing(_circle(count), (), (), duration)
        rows.append(speed_row(f'coordinator: {count} agents', times))
    return rows


def layer_rows() -> list[Row]:
    """Trot for 4 s; each layer with its kinematics."""
    with (
        timed(closed_loop.Planner, 'step') as planning,
        timed(WholeBodyController, 'track') as tracking,
    ):
        ClosedLoop(walk(forward=0.4)).run(4.0)
    return [speed_row('ground-force MPC', planning), speed_row('whole-body control', tracking)]


def simulator_rows() -> list[Row]:
    """Let robots stand by stiff joints in the world of both scenarios."""
    rows = []
    for name in SCENARIOS:
        scenario, model, measured = load_scenario(name), RobotModel(), []
        poses = [model.nominal_configuration(np.array(r.position), r.yaw) for r in scenario.robots]
        world = BulletWorld(scenario, SimulatorParameters(), poses)
        with timed(BulletWorld, 'step') as times:
            for tick in range(1000):
                world.step(
                    np.array([_stiff(s, p) for s, p in zip(world.states(), poses, strict=True)])
                )
                if tick % 10 == 0:
                    measured += durations(world.clearances, 1, 1)
        world.close()
        rows.append(speed_row(f'simulator step: {name}', times))
        rows.append(speed_row(f'simulator clearances: {name}', measured))
    return rows


def tracker_rows() -> list[Row]:
    """Track three obstacles at 100 Hz for 5 s."""
    scenario, rng = load_scenario(SCENARIOS[0]), np.random.default_rng(0)
    tracker = ObstacleTracker(ObstacleTrackerParameters())
    state = tracker.start(0)
    with timed(ObstacleTracker, 'step') as times:
        for tick in range(1, 500):
            places = np.array([thing.motion.at(0.01 * tick)[0] for thing in scenario.obstacles])
            seen = places + rng.normal(scale=0.005, size=places.shape)
            state = tracker.step(state, 10_000_000 * tick, seen).state
    return [speed_row('obstacle tracker: 3 obstacles', times)]


def message_rows() -> list[Row]:
    """Encode and decode the messages of the fast paths."""
    rows = []
    for name, (encode, decode) in _codecs().items():
        data = encode()
        rows.append(speed_row(f'encode {name} ({len(data)} bytes)', durations(encode, 300)))
        rows.append(speed_row(f'decode {name}', durations(partial(decode, data), 300)))
    return rows


def recorder_rows() -> list[Row]:
    """Write what four robots send in 2 ms, again and again, into a compressed bag."""
    shares = dict(zip(('state', 'plan', 'forces', 'command'), (2, 1, 4, 8), strict=True))
    with tempfile.TemporaryDirectory() as folder:
        bag = BagWriter(Path(folder, 'bag'), compression='lz4')
        sent = []
        for (name, (encode, _)), share in zip(_codecs().items(), shares.values(), strict=True):
            sent += share * [(bag.add_topic('/' + name.split()[0], STAMPED), encode())]

        def thousand() -> None:
            for k in range(1000):
                topic, data = sent[k % len(sent)]
                bag.write(topic, data, k, k)

        times = durations(thousand, 30, 1)
        bag.close()
    return [speed_row('recorder: 1000 messages', times, 'ms')]


def _crossing(
    robots: Sequence[Robot], walls: Sequence[Wall], obstacles: Sequence[Obstacle], duration: float
) -> list[float]:
    """Return the times of the coordinator's steps while ideal robots cross [ns]."""
    coordinator = Coordinator(CoordinatorParameters(), robots, walls, CROSSING_RATE)
    state = coordinator.start(0)
    with timed(Coordinator, 'step') as times:
        for tick in range(round(duration * CROSSING_RATE)):
            now = tick / CROSSING_RATE
            seen = [track(o.name, *o.motion.at(now), stamp_ns=state.stamp_ns) for o in obstacles]
            state = coordinator.step(state, told(state, seen)).state
    return times


def _circle(count: int) -> list[Robot]:
    """Return robots on a circle, 1.2 m apart, who all want to the other side."""
    places = 0.6 * count / math.pi * np.exp(2j * math.pi * np.arange(count) / count)
    return [
        Robot(f'a1_{i}', (p.real, p.imag), desired=Desired(goal=(-p.real, -p.imag)))
        for i, p in enumerate(places)
    ]


def _stiff(state: closed_loop.RobotState, pose: Array) -> Array:
    """Return torques that hold the joints of a pose [Nm], (12,)."""
    return 100.0 * (pose[7:] - state.configuration[7:]) - 2.0 * state.velocity[6:]


def _codecs() -> dict[str, tuple[Callable[[], bytes], Callable[[bytes], object]]]:
    """Return how each kind of message is encoded and decoded."""
    rng = np.random.default_rng(0)
    states, motions = ([make(rng) for _ in FOUR] for make in (samples.state, samples.motion))
    swing = np.array([0.0, 0.5, 0.5, 0.0])
    forces = GroundForcePlan(0, *rng.normal(size=(2, 4, 3)), swing, swing, rng.normal(size=12))
    torques, zeros = rng.normal(size=12), np.zeros(12)
    state, plan, command = StateWriter(FOUR), TrajectoryWriter(FOUR), JointStateWriter(JOINT_NAMES)
    planned = GroundForceWriter()
    return {
        'state of 4 robots': (lambda: state.encode(states), StateReader('a1_2').read),
        'plan of 4 robots': (lambda: plan.encode(0, motions), TrajectoryReader('a1_2').read),
        'forces': (lambda: planned.encode(forces), GroundForceReader().read),
        'command': (
            lambda: command.encode(0, zeros, zeros, torques),
            JointStateReader(JOINT_NAMES).read,
        ),
    }


SPEED = {
    'calibration': calibration_rows,
    'coordinator': coordinator_rows,
    'layers': layer_rows,
    'simulator': simulator_rows,
    'tracker': tracker_rows,
    'messages': message_rows,
    'recorder': recorder_rows,
}
"""Each measurement by its name."""
