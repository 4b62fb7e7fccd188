"""The parts of a scenario file: one function reads one part, strictly."""

from __future__ import annotations

import ipaddress
import math
from typing import Any

from layered_cbf_ros.scenario import (
    A1,
    BASES,
    BULLET,
    EMULATED_A1,
    ESTIMATOR,
    LEGGED,
    OMNI,
    TRUTH,
    UNICYCLE,
    Desired,
    Detections,
    Obstacle,
    Push,
    Rates,
    Robot,
    Wall,
    World,
)
from layered_cbf_ros.scenario_motion import PATTERNS, optional_number, read_desired, read_pattern
from layered_cbf_ros.timing import LOCKSTEP, REAL_TIME
from layered_cbf_ros.yaml_entry import Entry

TIMES = (LOCKSTEP, REAL_TIME)
PLANTS = (BULLET, BASES, A1, EMULATED_A1)
STATES = {
    BULLET: (TRUTH, ESTIMATOR),
    BASES: (TRUTH,),
    A1: (ESTIMATOR,),
    EMULATED_A1: (ESTIMATOR, TRUTH),
}
"""What may feed the layers, of each plant; the usual comes first."""
KINDS = {BULLET: (LEGGED,), BASES: (OMNI, UNICYCLE), A1: (LEGGED,), EMULATED_A1: (LEGGED,)}
OWN = {
    BULLET: ('payload',),
    BASES: ('radius',),
    A1: ('address', 'payload'),
    EMULATED_A1: ('address', 'payload'),
}
"""Fields of a robot that not every plant has."""
GAITS = ('trot', 'stand')
STATE_RATES = {  # whole steps of the simulator's 1 ms
    BULLET: (1000, 500, 250),
    BASES: (1000, 500, 250, 200, 100),
    A1: (1000, 500, 250),
    EMULATED_A1: (1000, 500, 250),
}
DEFAULT_RATES = {
    BULLET: Rates(),
    BASES: Rates(100, 100, 100),
    A1: Rates(),
    EMULATED_A1: Rates(),
}
MAX_SEED = 2**32 - 1


def read_run_settings(entries: dict[str, Entry]) -> dict[str, Any]:
    """Read what belongs to the run as a whole, where it is given."""
    settings: dict[str, Any] = {}
    if 'seed' in entries:
        settings['seed'] = entries['seed'].whole(0, MAX_SEED)
    if 'duration' in entries:
        settings['duration'] = entries['duration'].positive('[s]')
    if 'time' in entries:
        settings['time'] = entries['time'].word(TIMES)
    if 'plant' in entries:
        settings['plant'] = entries['plant'].word(PLANTS)
    if 'pace' in entries:
        settings['pace'] = entries['pace'].number(0.01, 1.0)
    if 'goal_tolerance' in entries:
        settings['goal_tolerance'] = entries['goal_tolerance'].positive('[m]')
    return settings


def read_robot(entry: Entry, plant: str) -> Robot:
    """Read one agent of a plant."""
    entries = entry.mapping(('name', 'position'), ('yaw', 'gait', 'desired', 'kind', *OWN[plant]))
    gait = entries['gait'].word(GAITS) if 'gait' in entries else 'trot'
    desired = read_desired(entries['desired']) if 'desired' in entries else Desired()
    if gait == 'stand' and desired != Desired():
        entries['gait'].refuse("say 'trot', or give this robot nothing desired")
    return Robot(
        name=entries['name'].ros_name(),
        position=entries['position'].point(),
        yaw=optional_number(entries, 'yaw', 0.0, -math.tau, math.tau, '[rad]'),
        gait=gait,
        desired=desired,
        payload=optional_number(entries, 'payload', 0.0, -4.0, 20.0, '[kg]'),
        kind=entries['kind'].word(KINDS[plant]) if 'kind' in entries else KINDS[plant][0],
        radius=entries['radius'].number(0.05, 2.0, '[m]') if 'radius' in entries else None,
        address=_address(entries['address']) if 'address' in entries else '',
    )


def _address(entry: Entry) -> str:
    """Read `IP:port`."""
    text = entry.text()
    host, _, port = text.rpartition(':')
    try:
        ipaddress.IPv4Address(host)
        in_range = 0 < int(port) < 65536
    except ValueError:
        in_range = False
    if text and not in_range:
        entry.refuse('give an IP address and a port, as 192.168.123.10:8007')
    return text


def read_obstacle(entry: Entry) -> Obstacle:
    """Read one obstacle."""
    entries = entry.mapping(('name', 'radius', 'motion'), ('height',))
    kind, motion = entries['motion'].one_of(PATTERNS)
    return Obstacle(
        name=entries['name'].ros_name(),
        radius=entries['radius'].positive('[m]'),
        height=entries['height'].positive('[m]') if 'height' in entries else 0.8,
        motion=read_pattern(kind, motion),
    )


def read_wall(entry: Entry) -> Wall:
    """Read one wall."""
    entries = entry.mapping(('name', 'point', 'normal'))
    x, y = entries['normal'].numbers(2)
    length = math.hypot(x, y)
    if length == 0.0:
        entries['normal'].refuse('give a direction, towards the allowed side')
    if abs(length - 1.0) > 1e-9:  # a unit vector stays as it is, to the bit
        x, y = x / length, y / length
    return Wall(entries['name'].ros_name(), entries['point'].point(), (x, y))


def read_world(entry: Entry) -> World:
    """Read the world."""
    entries = entry.mapping((), ('friction', 'torque_delay', 'pushes', 'detections'))
    return World(
        friction=optional_number(entries, 'friction', 0.8, 0.0, 2.0),
        torque_delay=optional_number(entries, 'torque_delay', 0.0, 0.0, 0.1, '[s]'),
        pushes=tuple(_push(push) for push in list_of(entries, 'pushes')),
        detections=_detections(entries['detections']) if 'detections' in entries else Detections(),
    )


def _push(entry: Entry) -> Push:
    entries = entry.mapping(('robot', 'at', 'duration', 'force'))
    x, y, z = entries['force'].numbers(3, '[N]')
    return Push(
        entries['robot'].text(),
        entries['at'].number(0.0, unit='[s]'),
        entries['duration'].positive('[s]'),
        (x, y, z),
    )


def _detections(entry: Entry) -> Detections:
    entries = entry.mapping((), ('noise', 'delay', 'dropout'))
    return Detections(
        noise=optional_number(entries, 'noise', 0.0, 0.0, 1.0, '[m]'),
        delay=optional_number(entries, 'delay', 0.0, 0.0, 1.0, '[s]'),
        dropout=optional_number(entries, 'dropout', 0.0, 0.0, 1.0),
    )


def read_rates(entry: Entry, plant: str) -> Rates:
    """Read the rates of a plant; each must fit the one above a whole number of times."""
    usual, choices = DEFAULT_RATES[plant], STATE_RATES[plant]
    entries = entry.mapping((), ('state', 'plan', 'detections'))
    state = entries['state'].whole(1, 1000) if 'state' in entries else usual.state
    if state not in choices:
        entries['state'].refuse(f'give one of {", ".join(map(str, choices))} Hz')
    plan = entries['plan'].whole(50, state) if 'plan' in entries else min(state, usual.plan)
    detections = (
        entries['detections'].whole(1, state) if 'detections' in entries else usual.detections
    )
    for name, value in (('plan', plan), ('detections', detections)):
        if state % value and name in entries:
            entries[name].refuse(f'give a divisor of the state rate, {state} Hz')
    if state % detections:
        entry.refuse(f'give detections as a divisor of the state rate, {state} Hz')
    return Rates(state, plan, detections)


def read_parameters(entry: Entry) -> dict[str, dict[str, Any]]:
    """Read the node parameters that the scenario overrides."""
    return {
        node: {name: value.value() for name, value in values.open_mapping().items()}
        for node, values in entry.open_mapping().items()
    }


def list_of(entries: dict[str, Entry], key: str) -> list[Entry]:
    """Return the entries of an optional list."""
    return entries[key].entries() if key in entries else []
