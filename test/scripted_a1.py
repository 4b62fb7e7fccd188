"""An A1 of a few lines on loopback, with byte layouts of its own: what it is told, it is.

It answers at 500 Hz whoever commanded it last. Its joints are at once where a stiff command
wants them, and never move otherwise.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from dataclasses import dataclass

COMMAND = struct.Struct('<BHHIB' + 20 * 'BffhhhIII' + '12s40sII')
STATE = struct.Struct('<BHHIB' + '13fb' + 20 * 'BffhhffhbII' + '4h4hI40sII')
ROBOT_ORDER = (3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8)
"""FR, FL, RR, RL as places in FL, FR, RL, RR, and the way back."""
LYING = (0.05, 1.11, -2.69) * 4
HAND = {'R2': 1 << 4, 'L2': 1 << 5, 'B': 1 << 9}
TABLE = []
for byte in range(256):
    value = byte << 24
    for _ in range(8):
        value = (value << 1 ^ 0x04C11DB7 if value & 1 << 31 else value << 1) & 0xFFFFFFFF
    TABLE.append(value)


def checksum(data: bytes) -> int:
    """Return CRC-32/MPEG-2 over little-endian words, most significant byte first."""
    crc = 0xFFFFFFFF
    for at in range(0, len(data), 4):
        for byte in data[at : at + 4][::-1]:
            crc = (crc << 8 & 0xFFFFFFFF) ^ TABLE[crc >> 24 ^ byte]
    return crc


@dataclass(frozen=True)
class Frame:
    """A command as the robot's motors have it, joints in our order."""

    at: float
    mode: tuple[int, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    torque: tuple[float, ...]
    kp: tuple[float, ...]
    kd: tuple[float, ...]

    @classmethod
    def unpacked(cls, data: bytes, at: float) -> Frame:
        """Read the bytes; they have to be what a real A1 takes."""
        fields = COMMAND.unpack(data)
        assert fields[0] == 0xFF
        assert fields[-1] == checksum(data[:604])
        motors = [fields[5 + 9 * k : 14 + 9 * k] for k in ROBOT_ORDER]
        mode, position, velocity, torque, kp, kd = list(zip(*motors, strict=True))[:6]
        scaled = ((torque, 256.0), (kp, 32.0), (kd, 16.0))
        torque, kp, kd = (tuple(x / scale for x in values) for values, scale in scaled)
        return cls(at, mode, position, velocity, torque, kp, kd)

    @property
    def damps(self) -> bool:
        """Tell whether it only takes energy out of the joints."""
        idle = not any((*self.kp, *self.torque, *self.velocity))
        return idle and set(self.mode) == {0x0A} and min(self.kd) >= 1.0

    @property
    def is_off(self) -> bool:
        return set(self.mode) == {0} and not any((*self.kp, *self.kd, *self.torque))


class ScriptedA1:
    """The robot; a thread of its own answers.

    Attributes:
        frames: All that it was told.
        silent: Whether it stopped telling.
        buttons: What is pressed on its remote control.
        told_at: When it first told of a press, monotonic [s].
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        self.frames: list[Frame] = []
        self.silent = False
        self.buttons = 0
        self.told_at = 0.0
        self._position = LYING
        self._mode = (0,) * 12
        self._sender = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def press(self, *names: str) -> None:
        """Press buttons of its remote control, and note when it tells so first."""
        self.buttons, self.told_at = sum(HAND[name] for name in names), 0.0

    def release(self) -> None:
        """Let all buttons go."""
        self.buttons = 0

    def answer_unasked(self, port: int) -> None:
        """Tell a driver that has asked nothing, as a robot does that another one commands."""
        self._sender = ('127.0.0.1', port)

    def end(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _live(self) -> None:
        tick = 0
        while not self._ended.wait(0.002):
            tick += 1
            self._hear()
            if self._sender is not None and not self.silent:
                telling = self._told(tick)
                if self.buttons and not self.told_at:
                    self.told_at = time.monotonic()
                self._socket.sendto(telling, self._sender)

    def _hear(self) -> None:
        while True:
            try:
                data, self._sender = self._socket.recvfrom(2048)
            except BlockingIOError:
                return
            frame = Frame.unpacked(data, time.monotonic())
            self.frames.append(frame)
            self._mode = frame.mode
            if any(frame.kp):
                self._position = frame.position

    def _told(self, tick: int) -> bytes:
        remote = struct.pack('<HH36x', 0x5155, self.buttons)
        angles, modes = self._position, self._mode
        fields = [0xFF, 0, 0, 0, 0, 1.0, 0.0, 0.0, 0.0, *(0.0, 0.0, 0.0)]
        fields += [0.0, 0.0, 9.81, 0.0, 0.0, 0.0, 30]
        for k in ROBOT_ORDER:
            q = angles[k]
            fields += [modes[k], q, 0.0, 0, 0, q, 0.0, 0, 30, 0, 0]
        fields += [0, 0.0, 0.0, 0, 0, 0.0, 0.0, 0, 0, 0, 0] * 8
        fields += [40, 40, 40, 40, 0, 0, 0, 0, tick, remote, 0, 0]
        data = bytearray(STATE.pack(*fields))
        struct.pack_into('<I', data, 767, checksum(bytes(data[:764])))
        return bytes(data)
