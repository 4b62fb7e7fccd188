"""Names of the topics of a run, and which of them each node acts on."""

from __future__ import annotations

from collections.abc import Sequence

from layered_cbf_ros.errors import LayeredCbfError

STATE, PLAN = '/state', '/safe_trajectory'
DETECTIONS, TRACKS, TRACKED = '/obstacles/detections', '/obstacles/tracks', '/obstacles/tracked'
TRUTH, CLEARANCE = '/obstacles/truth', '/simulator/clearance'
BARRIERS, INTERVENTION = '/coordinator/barriers', '/coordinator/intervention'
DESIRED, BALLS = '/coordinator/desired', '/coordinator/balls'
SCENARIO, DIAGNOSTICS = '/scenario', '/diagnostics'
JOY, E_STOP, COMMANDS = '/joy', '/e_stop', '/coordinator/commands'
MARKERS, TRANSFORMS = '/markers', '/tf'
PAUSE, STEP = '/simulator/pause', '/simulator/step'  # services
ONE_OF_A_KIND = {
    'coordinator': (STATE, TRACKS, TRACKED),
    'obstacle_tracker': (DETECTIONS,),
}
PER_ROBOT = ('ground_force_mpc', 'whole_body_controller')


def odometry(robot: str) -> str:
    """Return the topic on which a robot tells where it is and how it moves."""
    return f'/{robot}/odom'


def measured(robot: str) -> str:
    """Return the topic on which a robot tells what its sensors read."""
    return f'/{robot}/measured'


def robot_state(robot: str) -> str:
    """Return the topic of the state of one robot, where each has a topic of its own."""
    return f'/{robot}/state'


def external_pose(robot: str) -> str:
    """Return the topic on which motion capture tells where a robot is."""
    return f'/{robot}/external_pose'


def cmd_vel(robot: str) -> str:
    """Return the topic on which a planner asks a robot for a velocity."""
    return f'/{robot}/cmd_vel'


def cmd_vel_safe(robot: str) -> str:
    """Return the topic on which a robot with its own locomotion is told its safe velocity."""
    return f'/{robot}/cmd_vel_safe'


def asked_on(robots: Sequence[str]) -> tuple[str, ...]:
    """Return the topics on which operators and planners ask; a run may be without them."""
    return (JOY, E_STOP, *(cmd_vel(name) for name in robots))


def inputs_of(node: str, robots: Sequence[str]) -> tuple[str, ...]:
    """Return the topics that a node acts on.

    Args:
        node: Its name: `coordinator`, `obstacle_tracker`, `simulator`, or with its robot
            `a1_0/ground_force_mpc`, `a1_0/whole_body_controller`; a leading slash is fine.
        robots: Names of the robots of the run.

    Raises:
        LayeredCbfError: If there is no such node.
    """
    robot, _, kind = node.strip('/').rpartition('/')
    if not robot and kind == 'coordinator':
        return (*ONE_OF_A_KIND[kind], *asked_on(robots))
    if not robot and kind in ONE_OF_A_KIND:
        return ONE_OF_A_KIND[kind]
    if not robot and kind == 'simulator':
        return tuple(f'/{name}/joint_commands' for name in robots)
    if robot in robots and kind in PER_ROBOT:
        forces = (f'/{robot}/ground_forces',) if kind == 'whole_body_controller' else ()
        return (STATE, PLAN, *forces)
    known = [*ONE_OF_A_KIND, 'simulator', *(f'{name}/{k}' for name in robots for k in PER_ROBOT)]
    raise LayeredCbfError(f"no node '{node}'; there are {', '.join(known)}")
