"""A bag of a run that never was: bodies move on known paths, so every figure is known.

Messages are filled field by field and serialised by rclpy, not by this package's codecs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseArray, Transform, Twist
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from layered_cbf_ros.bags.storage.metadata import qos_yaml
from layered_cbf_ros.bags.storage.writer import BagWriter
from layered_cbf_ros.interfaces import JOINT_NAMES, LEGS, NS_PER_S
from layered_cbf_ros.patterns import Circle
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Desired, Obstacle, Robot, Scenario, Wall
from layered_cbf_ros.scenario_file import to_json

START_NS = 3 * NS_PER_S
LOG_START_NS = 1_700_000_000 * NS_PER_S
BASE = ('base_x', 'base_y', 'base_z', 'base_qx', 'base_qy', 'base_qz', 'base_qw')
LANE = 1.5  # between neighbouring robots [m]
SPEED = 0.5
GOAL_X = 0.8
TOLERANCE = 0.1


@dataclass(frozen=True)
class Recipe:
    """What happens.

    Robots walk along x at SPEED, LANE apart, from x = 0, in their nominal pose; the
    plan leads the CoM by `plan_error`. Times are since the first state.
    """

    robots: tuple[str, ...] = ('a1_0', 'a1_1')
    duration: float = 2.0
    period_ns: int = 2_000_000
    real_time_factor: float = 0.5
    plan_error: float = 0.004
    torque: float = 12.5
    clearance: float = 0.7
    fall_at: float = math.inf
    touch_at: float = math.inf
    scrape_at: float = math.inf
    walks: bool = True
    solver_failures: int = 0
    restart_at: float = math.inf
    nudge: float = 0.0
    left_out: tuple[str, ...] = ()
    repeat_every: int = 0
    compression: str = 'none'


@dataclass
class SyntheticRun:
    """Builds the messages of a recipe."""

    recipe: Recipe = field(default_factory=Recipe)

    def __post_init__(self) -> None:
        """Build the scenario and the standing pose."""
        robots = [
            Robot(name, (0.0, LANE * i), desired=Desired(goal=(GOAL_X, LANE * i)))
            for i, name in enumerate(self.recipe.robots)
        ]
        self.obstacle = Obstacle('obstacle_1', 0.25, 1.0, Circle((0.5, -1.6), 0.3, 0.4))
        self.scenario = Scenario(
            name='synthetic',
            description='A run that never was.',
            seed=7,
            duration=30.0,
            time='lockstep',
            plant='bullet',
            goal_tolerance=TOLERANCE,
            robots=tuple(robots),
            obstacles=(self.obstacle,),
            walls=(Wall('wall_right', (0.0, -3.0), (0.0, 1.0)),),
        )
        model = RobotModel()
        self._pose = model.nominal_configuration(np.zeros(2), 0.0)
        self._pose_com = model.com.copy()

    def com(self, robot: int, t: float) -> np.ndarray:
        """Where a robot's CoM is in the plane [m]."""
        return np.array([SPEED * t if self.recipe.walks else 0.0, LANE * robot])

    def configuration(self, robot: int, t: float) -> np.ndarray:
        """Where all of it is, as in RobotState."""
        pose = self._pose.copy()
        pose[:2] += self.com(robot, t) - self._pose_com[:2]
        if robot == 0 and t >= self.recipe.fall_at:
            pose[3:7] = math.sin(0.6), 0.0, 0.0, math.cos(0.6)  # 69 degrees of roll
        return pose

    def state(self, t_ns: int) -> JointState:
        """Return /state."""
        message = JointState(header=header(t_ns))
        for i, name in enumerate(self.recipe.robots):
            q = self.configuration(i, t_ns / NS_PER_S)
            if i == 0 and t_ns == 500 * self.recipe.period_ns:
                q[7] += self.recipe.nudge
            message.name += [f'{name}/{part}' for part in (*BASE, *JOINT_NAMES)]
            message.name += [f'{name}/{leg}_foot' for leg in LEGS]
            message.position.extend([*q, 0.0, 0.0, 0.0, 0.0])
            message.velocity.extend([SPEED, *[0.0] * 22])
            torques = [self.recipe.torque * (-1) ** k * (0.5 if k else 1.0) for k in range(12)]
            message.effort.extend([*[0.0] * 7, *torques, *[30.5] * 4])
        return message

    def plan(self, t_ns: int) -> MultiDOFJointTrajectory:
        """Return /safe_trajectory."""
        point = MultiDOFJointTrajectoryPoint(time_from_start=Duration())
        for i in range(len(self.recipe.robots)):
            transform = Transform()
            x, y = self.com(i, t_ns / NS_PER_S)
            transform.translation.x = x + self.recipe.plan_error
            transform.translation.y = y
            velocity = Twist()
            velocity.linear.x = SPEED
            point.transforms.append(transform)
            point.velocities.append(velocity)
            point.accelerations.append(Twist())
        names = list(self.recipe.robots)
        return MultiDOFJointTrajectory(header=header(t_ns), joint_names=names, points=[point])

    def clearance(self, t_ns: int) -> JointState:
        """Return /simulator/clearance."""
        first, *others = names = self.recipe.robots
        t = t_ns / NS_PER_S
        rows = [(f'{first}~{other}', self.recipe.clearance, 0.0) for other in others]
        rows += [(f'{a}~{b}', 1.0, 0.0) for k, a in enumerate(others) for b in others[k + 1 :]]
        for name in names:
            touch = 40.0 if name == first and t >= self.recipe.touch_at else 0.0
            scrape = 9.0 if name == first and t >= self.recipe.scrape_at else 0.0
            rows += [(f'{name}~obstacle_1', 0.9, touch), (f'{name}~wall_right', 2.0, 0.0)]
            rows.append((f'{name}~ground', 0.2, scrape))
        return joint_state(t_ns, rows)

    def trajectory(self, t_ns: int, names: list[str]) -> JointTrajectory:
        """Return 10 ticks of named figures, as on /coordinator/barriers."""
        points = []
        for k in range(10):
            offset_ns = k * self.recipe.period_ns
            t = (t_ns + offset_ns) / NS_PER_S
            figures = [
                [1.0 + 0.1 * i + math.cos(3.0 * t + i) for i in range(len(names))],
                [0.5 + math.sin(3.0 * t + i) ** 2 for i in range(len(names))],
                [0.1] * len(names),
                [0.0] * len(names),
            ]
            time = Duration(sec=0, nanosec=offset_ns)
            points.append(JointTrajectoryPoint(
                positions=figures[0], velocities=figures[1], accelerations=figures[2],
                effort=figures[3], time_from_start=time,
            ))  # fmt: skip
        return JointTrajectory(header=header(t_ns), joint_names=names, points=points)

    def diagnostics(self, t_ns: int, node: str) -> DiagnosticArray:
        """Return /diagnostics of one node."""
        failures = self.recipe.solver_failures if node == '/coordinator' else 0
        if t_ns / NS_PER_S >= self.recipe.restart_at:
            failures = 0
        values = {'ticks': 5, 'solver_failures': failures, 'slack_events': 0, 'rejected': 1}
        if node != '/simulator':
            values |= {'solve_time_p50_us': 400 + t_ns // 10**7, 'solve_time_p99_us': 900}
            values['solve_time_max_us'] = 1500
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        status = DiagnosticStatus(name=node, message='running', values=pairs)
        return DiagnosticArray(header=header(t_ns), status=[status])

    def messages(self) -> Iterator[tuple[int, str, str, object]]:
        """Yield time since the start [ns], topic, type and message."""
        robots, recipe = self.recipe.robots, self.recipe
        nodes = ['/coordinator', '/simulator']
        nodes += [
            f'/{r}/{n}' for r in robots for n in ('ground_force_mpc', 'whole_body_controller')
        ]
        yield 0, '/scenario', 'std_msgs/msg/String', String(data=to_json(self.scenario))
        for node in nodes:
            yield 0, '/ready', 'std_msgs/msg/String', String(data=node)
        for tick in range(round(recipe.duration * NS_PER_S) // recipe.period_ns + 1):
            t_ns = tick * recipe.period_ns
            yield t_ns, '/state', 'sensor_msgs/msg/JointState', self.state(t_ns)
            if tick % 2 == 0:
                kind = 'trajectory_msgs/msg/MultiDOFJointTrajectory'
                yield t_ns, '/safe_trajectory', kind, self.plan(t_ns)
            if tick % 10 == 0:
                yield from self._slower(t_ns)
            if tick % 250 == 0:
                for node in nodes:
                    kind = 'diagnostic_msgs/msg/DiagnosticArray'
                    yield t_ns, '/diagnostics', kind, self.diagnostics(t_ns, node)

    def _slower(self, t_ns: int) -> Iterator[tuple[int, str, str, object]]:
        """Yield what goes out every ten ticks."""
        joints, robots = 'sensor_msgs/msg/JointState', self.recipe.robots
        pairs = [f'{a}~obstacle_1' for a in robots] + [f'{robots[0]}~wall_right']
        trajectory = 'trajectory_msgs/msg/JointTrajectory'
        clock = Clock(clock=stamp(t_ns))
        yield t_ns, '/clock', 'rosgraph_msgs/msg/Clock', clock
        yield t_ns, '/simulator/clearance', joints, self.clearance(t_ns)
        yield t_ns, '/coordinator/barriers', trajectory, self.trajectory(t_ns, pairs)
        yield t_ns, '/coordinator/intervention', trajectory, self.trajectory(t_ns, list(robots))
        yield t_ns, '/coordinator/balls', joints, joint_state(t_ns, [(f'{pairs[0]}/r', 0.4, 0.0)])
        x, y = self.obstacle.motion.at(t_ns / NS_PER_S)[0]
        poses = PoseArray(header=header(t_ns), poses=[Pose()])
        poses.poses[0].position.x, poses.poses[0].position.y = float(x), float(y)
        for topic in ('truth', 'detections', 'tracked'):
            yield t_ns, f'/obstacles/{topic}', 'geometry_msgs/msg/PoseArray', poses
        track = Odometry(header=header(t_ns), child_frame_id='obstacle_1')
        yield t_ns, '/obstacles/tracks', 'nav_msgs/msg/Odometry', track
        for name in robots:
            row = joint_state(t_ns, [(joint, 0.1, 1.0) for joint in JOINT_NAMES])
            for topic in ('ground_forces', 'joint_commands', 'joint_states', 'foot_contacts'):
                yield t_ns, f'/{name}/{topic}', joints, row
            yield t_ns, f'/{name}/odom', 'nav_msgs/msg/Odometry', Odometry(header=header(t_ns))
            yield t_ns, f'/{name}/imu', 'sensor_msgs/msg/Imu', Imu(header=header(t_ns))


def stamp(t_ns: int) -> Time:
    """Return the stamp of a time since the start."""
    seconds, nanoseconds = divmod(START_NS + t_ns, NS_PER_S)
    return Time(sec=seconds, nanosec=nanoseconds)


def header(t_ns: int) -> Header:
    """Return a header in the world frame."""
    return Header(stamp=stamp(t_ns), frame_id='world')


def joint_state(t_ns: int, rows: list[tuple[str, float, float]]) -> JointState:
    """Return names with position and effort."""
    names, positions, efforts = map(list, zip(*rows, strict=True))
    zeros = [0.0] * len(rows)
    return JointState(
        header=header(t_ns), name=names, position=positions, velocity=zeros, effort=efforts
    )


def write_bag(folder: Path, recipe: Recipe | None = None) -> Path:
    """Write the bag of a recipe; return its folder."""
    run = SyntheticRun(recipe or Recipe())
    recipe = run.recipe
    topics: dict[str, int] = {}
    with BagWriter(folder, recipe.compression) as bag:
        for count, (t_ns, topic, kind, message) in enumerate(run.messages()):
            if topic in recipe.left_out:
                continue
            if topic not in topics:
                latched = 'transient_local' if topic in ('/scenario', '/ready') else 'volatile'
                topics[topic] = bag.add_topic(topic, kind, qos_yaml('reliable', latched))
            log_ns = LOG_START_NS + round(t_ns / recipe.real_time_factor)
            again = recipe.repeat_every and count % recipe.repeat_every == 0
            for _ in range(2 if again else 1):
                bag.write(topics[topic], serialize_message(message), log_ns, START_NS + t_ns)
    return folder
