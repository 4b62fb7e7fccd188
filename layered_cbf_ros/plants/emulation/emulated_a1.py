"""One emulated A1: commands in by its channel, torques on its joints, states out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array, RobotState
from layered_cbf_ros.plants.a1.frames import LowCommand, LowState
from layered_cbf_ros.plants.a1.packets import FrameError, pack_state, unpack_command
from layered_cbf_ros.plants.a1.peer import Address
from layered_cbf_ros.plants.a1.remote import write_remote
from layered_cbf_ros.plants.bullet_world import ImuReading
from layered_cbf_ros.plants.emulation.channel import Channel
from layered_cbf_ros.plants.emulation.motors import Motors, joint_torques
from layered_cbf_ros.plants.emulation.sensors import Sensors
from layered_cbf_ros.scenario_emulation import Emulation, pressed_at

ANSWERED_NS = NS_PER_S
"""So long after its last good command a sender still gets states: a guess [ns]."""
TICK_NS = 1000
"""Unit of the robot's own clock, as the maker's header has it [ns]."""


class EmulatedA1:
    """What a driver can tell of a robot. Before its first command it lies limp and silent.

    Attributes:
        command: The command in force; None: the motors are off.
        refused: Packets that were refused, by kind.
        timeouts: How often commands stopped.
    """

    def __init__(self, name: str, emulation: Emulation, torque_limit: float, seed: int) -> None:
        """Prepare.

        Args:
            name: The robot's.
            emulation: What it gets wrong.
            torque_limit: Largest torque of a joint [Nm].
            seed: Of all its chances.
        """
        inward, outward, sensors = np.random.default_rng(seed).spawn(3)
        self._name, self._e, self._limit = name, emulation, torque_limit
        self._inward: Channel[Address] = Channel(emulation, inward)
        self._outward: Channel[Address] = Channel(emulation, outward)
        self._sensors = Sensors(emulation, sensors)
        self._motors = Motors.cold(emulation.ambient_temperature)
        self._driver: Address | None = None
        self._heard_ns = 0
        self._timeout_ns = round(emulation.command_timeout * NS_PER_S)
        self.command: LowCommand | None = None
        self.refused: Counter[str] = Counter()
        self.timeouts = 0

    @property
    def hottest(self) -> float:
        """Return the temperature of the warmest motor [degC]."""
        return float(self._motors.temperature.max())

    def hear(self, now_ns: int, packets: Sequence[tuple[bytes, Address]]) -> None:
        """Take what came, let it cross the channel, and obey what has crossed it.

        Args:
            now_ns: The run's time [ns].
            packets: Bytes and sender of each.
        """
        for packet, sender in packets:
            self._inward.put(now_ns, packet, sender)
        for packet, sender in self._inward.due(now_ns):
            try:
                self.command = unpack_command(packet)
            except FrameError as error:
                self.refused[error.kind] += 1
                continue
            self._driver, self._heard_ns = sender, now_ns
        if self.command is not None and now_ns - self._heard_ns > self._timeout_ns:
            self.command = None
            self.timeouts += 1

    def torques(self, state: RobotState, dt: float) -> Array:
        """Return the torques of the joints [Nm], (12,), for a step of dt [s]."""
        position, velocity = state.configuration[7:], state.velocity[6:]
        wanted = joint_torques(self.command, position, velocity)
        torques = self._motors.limited(wanted, velocity, self._limit)
        self._motors = self._motors.after(torques, dt)
        return torques

    def answers(self, state: RobotState, imu: ImuReading) -> list[tuple[bytes, Address]]:
        """Return the packets that arrive at the driver now, each with its address.

        Whether a real robot sends by itself, or answers, isn't known; this one sends at
        every step as long as somebody has commanded it lately.
        """
        now_ns = state.stamp_ns
        if self._driver is not None and now_ns - self._heard_ns <= ANSWERED_NS:
            self._outward.put(now_ns, pack_state(self._told(state, imu)), self._driver)
        return self._outward.due(now_ns)

    def _told(self, state: RobotState, imu: ImuReading) -> LowState:
        measured = self._sensors.read(state, imu)
        held = pressed_at(self._e.remote, self._name, state.stamp_ns / NS_PER_S)
        position, velocity, torque = measured.joints
        return LowState(
            state.stamp_ns // TICK_NS,
            self._motors.modes(self.command).astype(np.int64),
            position,
            velocity,
            torque,
            np.rint(self._motors.temperature).astype(np.int64),
            measured.orientation,
            measured.angular_velocity,
            measured.specific_force,
            np.rint(measured.foot_forces),
            write_remote(held),
        )
