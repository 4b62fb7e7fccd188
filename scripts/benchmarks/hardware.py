"""What an A1's packets cost its driver, with their checksums."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from benchmarks.row import Row
from benchmarks.speed import durations, speed_row
from layered_cbf_ros.plants.a1.frames import SERVO, LowCommand, LowState
from layered_cbf_ros.plants.a1.packets import CommandPacker, pack_state, unpack_state

BATCHES = 1000
PACKED_WITHIN = 10.0  # [us]: a hundredth of the driver's cycle


def packet_rows() -> list[Row]:
    """Pack commands and unpack states, each another one than the one before."""
    rng = np.random.default_rng(0)
    packer = CommandPacker(torque_limit=33.5)
    commands = itertools.cycle([_command(rng) for _ in range(10)])
    states = itertools.cycle([pack_state(_state(rng)) for _ in range(10)])
    packing = durations(lambda: packer.pack(next(commands)), BATCHES)
    unpacking = durations(lambda: unpack_state(next(states)), BATCHES)
    packed = speed_row('A1 command: pack with checksum', packing)
    return [
        replace(packed, must=PACKED_WITHIN),
        speed_row('A1 state: check and unpack', unpacking),
    ]


def _command(rng: np.random.Generator) -> LowCommand:
    position, velocity, torque = rng.normal(scale=((1.0,), (5.0,), (10.0,)), size=(3, 12))
    return LowCommand(SERVO, position, velocity, torque, np.full(12, 20.0), np.full(12, 3.0))


def _state(rng: np.random.Generator) -> LowState:
    servo, level = np.full(12, SERVO), np.array([0.0, 0.0, 0.0, 1.0])
    joints, (gyro, force) = rng.normal(size=(3, 12)), rng.normal(size=(2, 3))
    return LowState(1, servo, *joints, servo, level, gyro, force, np.full(4, 30.0), bytes(40))
