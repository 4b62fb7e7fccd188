"""A live node that gets its inputs from a bag: what it needs, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.bags.recorded_scenario import recorded_scenario
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.errors import BagError, LayeredCbfError
from layered_cbf_ros.node_topics import (
    COMMANDS,
    DETECTIONS,
    PLAN,
    STATE,
    TRACKED,
    TRACKS,
    asked_on,
    inputs_of,
)
from layered_cbf_ros.scenario import BASES

JOINTS, POSES = 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/PoseArray'


@dataclass(frozen=True)
class Output:
    """A topic that a node sends to partners.

    Attributes:
        topic, type_name: What.
        readers: How many of them the node waits for in lockstep.
    """

    topic: str
    type_name: str
    readers: int


@dataclass(frozen=True)
class FedNode:
    """One node, fed from a bag.

    Attributes:
        name: Full name.
        inputs: Topics that it acts on and the bag has.
        absent: Topics that it needs and the bag has not.
        leader: The input whose stamps are its ticks.
        outputs: What it sends; the stamps of the first tell which ticks it has done.
        ticks: Leading messages to one answer, in lockstep.
        ticks_in_real_time: The same in real time.
        was_steered: Whether it also acted on what was asked of it in the wall's time.
    """

    name: str
    inputs: tuple[str, ...]
    absent: tuple[str, ...]
    leader: str
    outputs: tuple[Output, ...]
    ticks: int = 1
    ticks_in_real_time: int = 1
    was_steered: bool = False


def fed_node(node: str, bag: Bag) -> FedNode:
    """Return what a replay must know of the node that it feeds.

    Args:
        node: Its name, see node_topics.inputs_of.
        bag: The bag; its /scenario tells the robots.

    Raises:
        BagError: If there is no such node in the run, or the bag lacks its leading input.
    """
    try:
        scenario = recorded_scenario(bag)
    except BagError as error:
        raise BagError(f'--inputs-of: {error}, or name the topics with --topics') from None
    if scenario.plant == BASES and node.strip('/') != 'obstacle_tracker':
        raise BagError(
            f'--inputs-of {node}: who hears a fleet hears a topic of every base, and no single '
            'one sets its pace; name the topics with --topics, or use re_solve'
        )
    robots = [robot.name for robot in scenario.robots]
    try:
        wanted = inputs_of(node, robots)
    except LayeredCbfError as error:
        raise BagError(f'--inputs-of: {error}') from None
    name = f'/{node.strip("/")}'
    inputs = tuple(topic for topic in wanted if topic in bag.topics)
    if wanted[0] not in inputs:
        raise BagError(f'--inputs-of {node}: the bag has no {wanted[0]}; record it with the run')
    needed = set(wanted) - set(asked_on(robots))
    absent = tuple(topic for topic in wanted if topic in needed and topic not in inputs)
    outputs = _outputs(name, len(robots))
    period = -(-scenario.rates.state // scenario.rates.plan)
    kind = name.rpartition('/')[2]
    ticks = period if kind in ('coordinator', 'ground_force_mpc') else 1
    in_real_time = period if kind == 'ground_force_mpc' else 1
    steered = kind == 'coordinator' and COMMANDS in bag.topics and not scenario.operator
    return FedNode(name, inputs, absent, wanted[0], outputs, ticks, in_real_time, steered)


def _outputs(name: str, robots: int) -> tuple[Output, ...]:
    """Return what a node sends to partners; the answer to its leading input comes first."""
    robot, _, kind = name.rpartition('/')
    if kind == 'coordinator':
        return (Output(PLAN, 'trajectory_msgs/msg/MultiDOFJointTrajectory', 2 * robots),)
    if kind == 'obstacle_tracker':
        return Output(TRACKED, POSES, 1), Output(TRACKS, 'nav_msgs/msg/Odometry', 1)
    if kind == 'simulator':
        return Output(STATE, JOINTS, 2 * robots + 1), Output(DETECTIONS, POSES, 1)
    topic = 'ground_forces' if kind == 'ground_force_mpc' else 'joint_commands'
    return (Output(f'{robot}/{topic}', JOINTS, 1),)
