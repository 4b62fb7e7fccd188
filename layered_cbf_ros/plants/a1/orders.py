"""What becomes of a driver's state when a person, or the end of the process, asks."""

from __future__ import annotations

from dataclasses import replace

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.plants.a1.driver_memory import (
    ACTIVE,
    Answer,
    Heard,
    Memory,
    Order,
    Phase,
)
from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.a1.driving import Driving

GOING_DOWN = (Phase.SITTING_DOWN, Phase.DAMPED, Phase.OFF)


def obey(
    driving: Driving, p: DriverParameters, memory: Memory, order: Order, heard: Heard
) -> tuple[Memory, Answer]:
    """Return the memory after an order, and the answer to whoever gave it."""
    if order is Order.ARM:
        return _arm(p, memory, heard)
    if order is Order.SIT_DOWN:
        return _sit_down(driving, memory, heard)
    if order is Order.RESET:
        return _reset(p, memory, heard)
    return _end(memory, heard), Answer(True, 'damped, then off')


def _arm(p: DriverParameters, memory: Memory, heard: Heard) -> tuple[Memory, Answer]:
    if p.listen_only:
        return memory, Answer(False, 'it only listens; start it without listen_only')
    if memory.fault:
        return memory, Answer(False, f'a fault is latched: {memory.fault}; reset it first')
    if memory.phase is not Phase.DISARMED:
        return memory, Answer(False, f'it is {memory.phase.value} already')
    words = 'stands up as soon as it answers' + (' (dry run)' if p.dry_run else '')
    return Memory(Phase.ENGAGING, heard.now_ns), Answer(True, f'{p.address}:{p.port} {words}')


def _sit_down(driving: Driving, memory: Memory, heard: Heard) -> tuple[Memory, Answer]:
    if memory.phase is Phase.FAULT:
        return memory, Answer(False, f'it is damped by a fault: {memory.fault}; reset it')
    if memory.phase is Phase.DISARMED:
        return memory, Answer(False, 'it is disarmed')
    if memory.phase in GOING_DOWN:
        return memory, Answer(True, f'it is {memory.phase.value} already')
    if memory.phase is Phase.ENGAGING:
        return _end(memory, heard), Answer(True, 'it never stood: damped, then off')
    begin, torque = _held_now(driving, memory, heard)
    down = replace(
        memory,
        phase=Phase.SITTING_DOWN,
        since_ns=heard.now_ns,
        path=driving.path_to_sit(begin),
        torque=torque,
    )
    return down, Answer(True, 'sits down, is damped, then off')


def _held_now(driving: Driving, memory: Memory, heard: Heard) -> tuple[Array, Array]:
    """Return the pose [rad] and torques [Nm] from which joints go on without a step."""
    none = 0.0 * driving.standing
    if memory.phase is Phase.STANDING_UP:
        return memory.path.at((heard.now_ns - memory.since_ns) / NS_PER_S)[0], none
    if memory.phase is Phase.RUNNING and heard.state is not None and heard.command is not None:
        return heard.state.position, heard.command.torque
    return driving.standing, none


def _reset(p: DriverParameters, memory: Memory, heard: Heard) -> tuple[Memory, Answer]:
    if not memory.trouble:
        return memory, Answer(False, 'no fault is latched')
    cleared = replace(memory, fault='', complaint='')
    answer = Answer(True, f'cleared: {memory.trouble}')
    if memory.phase is not Phase.FAULT:
        return cleared, answer
    words = f'{answer.message}; motors are off in {p.damped_time:g} s'
    return _damped(cleared, heard), Answer(True, words)


def _end(memory: Memory, heard: Heard) -> Memory:
    """Damp whoever is driven; what goes down already goes on."""
    if memory.phase is Phase.FAULT or memory.phase in ACTIVE or memory.phase is Phase.ENGAGING:
        return _damped(memory, heard)
    return memory


def _damped(memory: Memory, heard: Heard) -> Memory:
    return replace(memory, phase=Phase.DAMPED, since_ns=heard.now_ns)
