"""What an emulated A1 gets wrong: its sensors, its motors, and the link to it."""

from __future__ import annotations

import dataclasses
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from layered_cbf_ros.yaml_entry import Entry


@dataclass(frozen=True)
class RemotePress:
    """Buttons of a robot's own remote control, held from `at` for `duration` [s]."""

    robot: str
    at: float
    duration: float
    buttons: tuple[str, ...]


BUTTONS = (
    *('R1', 'L1', 'start', 'select', 'R2', 'L2', 'F1', 'F2'),
    *('A', 'B', 'X', 'Y', 'up', 'right', 'down', 'left'),
)
"""Of the remote control, from bit 0 on."""


def _share(default: float = 0.0) -> Any:
    return dataclasses.field(default=default, metadata={'maximum': 1.0})


def _size(default: float = 0.0, maximum: float = 1.0, unit: str = '') -> Any:
    return dataclasses.field(default=default, metadata={'maximum': maximum, 'unit': unit})


@dataclass(frozen=True)
class Emulation:
    """How emulated robots differ from perfect ones; by default in nothing.

    Attributes:
        address: IP address at which the emulated robots listen.
        port: UDP port of the first robot; each further one has the next.
        lying: Whether robots lie on their bellies at the start, as real ones do.
        encoder_noise, encoder_velocity_noise: Deviations of joint angles [rad] and
            velocities [rad/s].
        gyro_noise, gyro_bias: White deviation, and size of a constant of random
            direction [rad/s].
        accelerometer_noise, accelerometer_bias: Likewise [m/s^2].
        tilt_bias: Size of a constant error of roll and pitch [rad].
        yaw_drift: Of the IMU's heading [rad/s].
        foot_force_scale: Sensor's unit per newton.
        foot_force_noise, foot_force_offset, foot_force_drift: In the sensor's unit; the
            offset of each foot is drawn up to this size, the drift is per second.
        ambient_temperature: Of the motors at the start [degC].
        latency, jitter: One way, and how much of it varies, each way [s].
        loss, duplication, reordering, corruption: Probabilities of what happens to a
            packet, each way.
        command_timeout: Silence after which an emulated robot damps its joints [s].
        remote: What is pressed on the remote controls.
    """

    address: str = '127.0.0.1'
    port: int = 8007
    lying: bool = True
    encoder_noise: float = _size(0.0, 0.1, '[rad]')
    encoder_velocity_noise: float = _size(0.0, 2.0, '[rad/s]')
    gyro_noise: float = _size(0.0, 1.0, '[rad/s]')
    gyro_bias: float = _size(0.0, 0.5, '[rad/s]')
    accelerometer_noise: float = _size(0.0, 5.0, '[m/s^2]')
    accelerometer_bias: float = _size(0.0, 2.0, '[m/s^2]')
    tilt_bias: float = _size(0.0, 0.1, '[rad]')
    yaw_drift: float = _size(0.0, 0.1, '[rad/s]')
    foot_force_scale: float = _size(1.0, 10.0)
    foot_force_noise: float = _size(0.0, 100.0)
    foot_force_offset: float = _size(0.0, 200.0)
    foot_force_drift: float = _size(0.0, 10.0)
    ambient_temperature: float = _size(25.0, 80.0, '[degC]')
    latency: float = _size(0.0, 0.1, '[s]')
    jitter: float = _size(0.0, 0.1, '[s]')
    loss: float = _share()
    duplication: float = _share()
    reordering: float = _share()
    corruption: float = _share()
    command_timeout: float = _size(0.1, 10.0, '[s]')
    remote: tuple[RemotePress, ...] = ()


def read_emulation(entry: Entry) -> Emulation:
    """Read the section, strictly."""
    fields = {field.name: field for field in dataclasses.fields(Emulation)}
    values: dict[str, Any] = {}
    for name, given in entry.mapping((), fields).items():
        metadata = fields[name].metadata
        if name == 'remote':
            values[name] = tuple(_press(press) for press in given.entries())
        elif name == 'address':
            values[name] = _ip_address(given)
        elif name == 'port':
            values[name] = given.whole(1024, 65000)
        elif name == 'lying':
            values[name] = given.yes_or_no()
        else:
            values[name] = given.number(0.0, metadata['maximum'], metadata.get('unit', ''))
    return Emulation(**values)


def _ip_address(entry: Entry) -> str:
    text = entry.text()
    try:
        ipaddress.IPv4Address(text)
    except ValueError:
        entry.refuse('give an IP address, as 127.0.0.1')
    return text


def _press(entry: Entry) -> RemotePress:
    given = entry.mapping(('robot', 'at', 'duration', 'buttons'))
    return RemotePress(
        given['robot'].text(),
        given['at'].number(0.0, unit='[s]'),
        given['duration'].positive('[s]'),
        tuple(button.word(BUTTONS) for button in given['buttons'].entries()),
    )


def pressed_at(presses: Sequence[RemotePress], robot: str, time: float) -> frozenset[str]:
    """Return the buttons held on a robot's remote control at a time [s]."""
    held = (p for p in presses if p.robot == robot and p.at <= time < p.at + p.duration)
    return frozenset(button for press in held for button in press.buttons)
