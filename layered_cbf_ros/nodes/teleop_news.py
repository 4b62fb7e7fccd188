"""What the operator's terminal hears of a run: the newest message of each topic, on demand."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from layered_cbf_ros.errors import LayeredCbfError, MessageError
from layered_cbf_ros.interfaces import NS_PER_S, Track
from layered_cbf_ros.messages.cdr import stamp_of
from layered_cbf_ros.messages.tracks import track_from
from layered_cbf_ros.messages.trajectory import TrajectoryReader
from layered_cbf_ros.node_topics import (
    BARRIERS,
    COMMANDS,
    DESIRED,
    DIAGNOSTICS,
    INTERVENTION,
    PLAN,
    SCENARIO,
    TRACKS,
)
from layered_cbf_ros.nodes.transport import Reader, decoded, latched
from layered_cbf_ros.operation.terminal_view import Heard, with_desired, with_tracks, with_words
from layered_cbf_ros.operation.told import read_told
from layered_cbf_ros.scenario_file import from_json

MANY = 64  # tracks of the newest stamp, words of many nodes
TOGETHER_NS = NS_PER_S // 50  # tracks of so nearly one stamp belong together


def quiet(depth: int = 1) -> QoSProfile:
    """Return the quality of service of a listener that slows nobody down."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


class TeleopNews:
    """Takes what has come when the screen is painted; in between nothing is decoded.

    Attributes:
        heard: What is known so far.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.heard = Heard()
        self._scenario = Reader(node, String, SCENARIO, latched())
        self._diagnostics = Reader(node, DiagnosticArray, DIAGNOSTICS, quiet(MANY))
        self._tracks = Reader(node, Odometry, TRACKS, quiet(MANY))
        self._plan = Reader(node, MultiDOFJointTrajectory, PLAN, quiet())
        self._odometry: dict[str, Reader] = {}
        self._plans: dict[str, TrajectoryReader] = {}
        self._found: list[Track] = []
        takers: dict[str, Callable[[bytes], None]] = {
            DESIRED: self._desired,
            BARRIERS: self._barriers,
            INTERVENTION: self._intervention,
            COMMANDS: self._commands,
        }
        self._series = [
            (Reader(node, JointTrajectory, topic, quiet()), take) for topic, take in takers.items()
        ]

    def expect(self, robots: tuple[str, ...]) -> None:
        """Listen to a team of robots."""
        if robots == self.heard.robots:
            return
        for reader in self._odometry.values():
            reader.end(self._node)
        self.heard = Heard(robots)
        self._odometry = {
            name: Reader(self._node, Odometry, f'/{name}/odom', quiet()) for name in robots
        }
        self._plans = {name: TrajectoryReader(name) for name in robots}

    def listen(self, now_ns: int) -> Heard:
        """Take what has come until now; return what is known.

        Args:
            now_ns: Wall time [ns].
        """
        _each(self._scenario, self._team)
        _each(self._diagnostics, self._words)
        for reader, take in self._series:
            if _each(reader, take):
                self.heard = replace(self.heard, heard_ns=now_ns)
        _each(self._plan, self._motions)
        for reader in self._odometry.values():
            _each(reader, self._robot)
        self._found.clear()
        _each(self._tracks, self._track)
        if self._found:
            self.heard = with_tracks(self.heard, _of_one_stamp(self._found))
        return self.heard

    def _team(self, data: bytes) -> None:
        text = decoded(data, String).data
        try:
            self.expect(tuple(robot.name for robot in from_json(text).robots))
        except (LayeredCbfError, json.JSONDecodeError):
            raise MessageError(f'{SCENARIO} is spoilt') from None

    def _words(self, data: bytes) -> None:
        for status in decoded(data, DiagnosticArray).status:
            if status.name == '/coordinator':
                told = {entry.key: entry.value for entry in status.values}
                self.heard = with_words(self.heard, told)

    def _desired(self, data: bytes) -> None:
        message = _series(data)
        if not self.heard.robots:  # nobody has told the scenario
            self.expect(tuple(dict.fromkeys(n.rpartition('/')[0] for n in message.joint_names)))
        last = message.points[-1]
        self.heard = with_desired(self.heard, message.joint_names, last.velocities, last.effort)

    def _barriers(self, data: bytes) -> None:
        message = _series(data)
        barriers = dict(zip(message.joint_names, message.points[-1].positions, strict=True))
        self.heard = replace(self.heard, barriers=barriers)

    def _intervention(self, data: bytes) -> None:
        message = _series(data)
        sizes = dict(zip(message.joint_names, message.points[-1].positions, strict=True))
        self.heard = replace(self.heard, interventions=sizes)

    def _commands(self, data: bytes) -> None:
        message, robots = _series(data), self.heard.robots
        last = message.points[-1]
        velocities, effort = np.array(last.velocities), np.array(last.effort)
        commands, stopped = read_told(message.joint_names, velocities, effort, robots)
        told = dict(zip(robots, commands, strict=True))
        self.heard = replace(self.heard, commands=told, is_stopped=stopped)

    def _motions(self, data: bytes) -> None:
        plans = {name: reader.read(data) for name, reader in self._plans.items()}
        self.heard = replace(self.heard, plans=plans, stamp_ns=stamp_of(data))

    def _robot(self, data: bytes) -> None:
        message = decoded(data, Odometry)
        name = message.child_frame_id.partition('/')[0]
        place, twist = message.pose.pose.position, message.twist.twist.linear
        self.heard = replace(
            self.heard,
            places={**self.heard.places, name: (place.x, place.y)},
            speeds={**self.heard.speeds, name: math.hypot(twist.x, twist.y)},
        )

    def _track(self, data: bytes) -> None:
        self._found.append(track_from(decoded(data, Odometry), 0.0))


def _each(reader: Reader, take: Callable[[bytes], None]) -> int:
    """Take the messages that wait; return how many. A bad one changes nothing here.

    Whoever acts on such a message in the run names it on /diagnostics.
    """
    for count in range(2 * MANY):  # as many as there are now, should more come meanwhile
        data = reader.take()
        if data is None:
            return count
        with contextlib.suppress(MessageError, ValueError):
            take(data)
    return 2 * MANY


def _series(data: bytes) -> JointTrajectory:
    """Return a series of ticks.

    Raises:
        MessageError: If it is none, or empty.
    """
    message = decoded(data, JointTrajectory)
    if not message.points:
        raise MessageError('a series of ticks has none')
    return message


def _of_one_stamp(tracks: list[Track]) -> dict[str, tuple[float, float]]:
    """Return the places of the tracks of the newest stamp, or nearly so [m]."""
    since_ns = max(track.stamp_ns for track in tracks) - TOGETHER_NS
    newest = [track for track in tracks if track.stamp_ns >= since_ns]
    return {track.name: (float(track.position[0]), float(track.position[1])) for track in newest}
