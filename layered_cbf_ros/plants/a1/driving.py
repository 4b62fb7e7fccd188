"""The states of an A1's driver: from disarmed to running, and down again.

Pure: what was heard and the time go in, a frame for the motors comes out, or none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S, Array
from layered_cbf_ros.plants.a1.driver_memory import (
    ACTIVE,
    UPRIGHT,
    Heard,
    JointCommand,
    Memory,
    Phase,
)
from layered_cbf_ros.plants.a1.driver_parameters import DriverParameters
from layered_cbf_ros.plants.a1.frames import SERVO, LowCommand
from layered_cbf_ros.plants.a1.poses import PosePath, folded_pose
from layered_cbf_ros.plants.a1.protection import Protection, mode_fault

MS = 1_000_000
NOTHING = 1.0
"""Sum of squared torques that hold no weight [Nm^2]; a standing A1 has a hundred of them."""


class Driving:
    """Decides, cycle by cycle, what one robot's motors are told."""

    def __init__(self, parameters: DriverParameters, standing: Array) -> None:
        """Make the driver's mind.

        Args:
            parameters: Times, gains and limits.
            standing: The pose in which the layers expect the robot [rad], (12,).
        """
        self._parameters = p = parameters
        self._protection = Protection(p)
        self.standing, self.folded = standing, folded_pose(p.folded_thigh)
        self._damping, self._off = LowCommand.damping(p.damping), LowCommand.off()
        self._zeros = np.zeros(12)

    def step(self, memory: Memory, heard: Heard) -> tuple[Memory, LowCommand | None]:
        """Return the memory for the next cycle, and what is sent; None sends nothing."""
        memory = self._advanced(self._guarded(memory, heard), heard)
        return memory, self._command(memory, heard)

    def path_to_stand(self, measured: Array) -> PosePath:
        """Return the way up: fold the legs under the body, then stretch them."""
        p = self._parameters
        return PosePath((measured, self.folded, self.standing), (p.fold_time, p.stand_up_time))

    def path_to_sit(self, begin: Array) -> PosePath:
        """Return the way down from a pose."""
        return PosePath((begin, self.folded), (self._parameters.sit_down_time,))

    def _guarded(self, memory: Memory, heard: Heard) -> Memory:
        """Latch what is wrong; whoever was driven is damped from this very cycle on."""
        if memory.phase is Phase.FAULT:
            return memory
        memory, fault = self._judged(memory, heard)
        if not fault:
            return memory
        if memory.phase in ACTIVE or memory.phase is Phase.ENGAGING:
            return replace(memory, phase=Phase.FAULT, since_ns=heard.now_ns, fault=fault)
        return replace(memory, fault=memory.fault or fault)

    def _judged(self, memory: Memory, heard: Heard) -> tuple[Memory, str]:
        """Return what is wrong, '' if nothing is."""
        if heard.emergency_stop:
            return memory, 'emergency stop'
        active = memory.phase in ACTIVE
        if not active and memory.phase is not Phase.ENGAGING:
            return memory, ''
        if heard.is_new and heard.state is not None:
            overloads, fault = self._protection.check(
                memory.overloads,
                heard.state,
                heard.buttons,
                memory.phase in UPRIGHT,
                active and not self._parameters.dry_run,
            )
            memory = replace(memory, overloads=overloads)
            if fault:
                return memory, fault
        return memory, self._silence(memory, heard) if active else ''

    def _silence(self, memory: Memory, heard: Heard) -> str:
        """Name who is silent for too long, or talks nonsense."""
        p, now_ns = self._parameters, heard.now_ns
        silent_ns = now_ns - heard.state_ns
        if silent_ns > p.state_timeout * NS_PER_S:
            return f'no state from the robot for {silent_ns / MS:.0f} ms'
        if heard.bad_command:
            return f'joint command refused: {heard.bad_command}'
        if memory.phase is Phase.RUNNING and not self._is_fresh(heard):
            command = heard.command
            age = 'yet' if command is None else f'for {(now_ns - command.stamp_ns) / MS:.0f} ms'
            return f'no joint command {age}'
        return ''

    def _is_fresh(self, heard: Heard) -> bool:
        if heard.command is None:
            return False
        age_ns = heard.now_ns - heard.command.stamp_ns
        return age_ns <= self._parameters.command_timeout * NS_PER_S

    def _advanced(self, memory: Memory, heard: Heard) -> Memory:
        """Go on to the next phase if it is time to."""
        p, time = self._parameters, (heard.now_ns - memory.since_ns) / NS_PER_S
        if memory.phase is Phase.ENGAGING:
            return self._engaged(memory, heard, time)
        if memory.phase is Phase.STANDING:
            takes_over = self._carries(heard)
            return _entered(memory, Phase.RUNNING, heard) if takes_over else memory
        following = {
            Phase.STANDING_UP: (memory.path.duration, Phase.STANDING),
            Phase.SITTING_DOWN: (memory.path.duration, Phase.DAMPED),
            Phase.DAMPED: (p.damped_time, Phase.OFF),
            Phase.OFF: (p.off_time, Phase.DISARMED),
        }
        if memory.phase in following:
            duration, phase = following[memory.phase]
            if time >= duration:
                return _entered(memory, phase, heard)
        return memory

    def _engaged(self, memory: Memory, heard: Heard, time: float) -> Memory:
        """Count the states in a row of a robot that obeys, and stand up; or give it up."""
        p, state = self._parameters, heard.state
        if heard.now_ns - heard.state_ns > p.state_timeout * NS_PER_S:
            memory = replace(memory, valid=0)
        elif heard.is_new and state is not None:
            obeys = p.dry_run or not mode_fault(state)
            memory = replace(memory, valid=memory.valid + 1 if obeys else 0)
        if state is not None and memory.valid >= p.needed_states:
            path = self.path_to_stand(state.position)
            return replace(_entered(memory, Phase.STANDING_UP, heard), path=path)
        if time < p.answer_timeout:
            return memory
        return replace(
            _entered(memory, Phase.DISARMED, heard), complaint=self._reason(memory, heard)
        )

    def _reason(self, memory: Memory, heard: Heard) -> str:
        """Tell why a robot is given up."""
        p, state = self._parameters, heard.state
        if state is None or heard.state_ns < memory.since_ns:
            return (
                f'no answer from {p.address}:{p.port} for {p.answer_timeout:g} s; is it on, is '
                f'this computer in its network, and may it answer to port {p.local_port}?'
            )
        if (refusal := mode_fault(state)) and not p.dry_run:
            return f'the robot does not obey: {refusal}'
        return (
            f'{memory.valid} of {p.needed_states} states in a row from {p.address}:{p.port} '
            f'in {p.answer_timeout:g} s; look at its network'
        )

    def _carries(self, heard: Heard) -> bool:
        """Tell whether a controller's torques would do what holds the robot now.

        One that only damps would let it fall: tau . tau_hold >= share |tau_hold|^2. If next
        to nothing holds it, nothing can fall.
        """
        if heard.command is None or heard.state is None or not self._is_fresh(heard):
            return False
        p = self._parameters
        stiff = p.stand_kp * (self.standing - heard.state.position)
        holding = stiff - p.stand_kd * heard.state.velocity
        needed = float(holding @ holding)
        carried = float(heard.command.torque @ holding)
        return needed < NOTHING or carried >= p.takeover_share * needed

    def _command(self, memory: Memory, heard: Heard) -> LowCommand | None:
        """Return what the motors are told in a phase."""
        p, phase = self._parameters, memory.phase
        time = (heard.now_ns - memory.since_ns) / NS_PER_S
        if phase is Phase.DISARMED:
            return None
        if phase is Phase.OFF:
            return self._off
        if phase is Phase.STANDING:
            return self._held(self.standing, self._zeros, self._zeros)
        if phase is Phase.STANDING_UP:
            return self._held(*memory.path.at(time), self._zeros)
        if phase is Phase.SITTING_DOWN:
            left = max(0.0, 1.0 - time / p.takeover_time)
            return self._held(*memory.path.at(time), left * memory.torque)
        if phase is Phase.RUNNING and heard.command is not None:
            return self._run(heard.command, min(1.0, time / p.takeover_time))
        return self._damping

    def _held(self, position: Array, velocity: Array, torque: Array) -> LowCommand:
        p = self._parameters
        kp, kd = np.full(12, p.stand_kp), np.full(12, p.stand_kd)
        return LowCommand(SERVO, position, velocity, torque, kp, kd)

    def _run(self, command: JointCommand, share: float) -> LowCommand:
        """Return the controller's part and the rest of the held pose's, in one joint law.

        Args:
            command: What the controller asks.
            share: Its part, growing from 0 to 1 after it took over.
        """
        p, rest = self._parameters, 1.0 - share
        kp, kd = rest * p.stand_kp + share * p.kp, rest * p.stand_kd + share * p.kd
        position, velocity = self.standing, self._zeros
        if kp > 0.0:
            held, asked = rest * p.stand_kp / kp, share * p.kp / kp
            position = held * self.standing + asked * command.position
        if kd > 0.0:
            velocity = (share * p.kd / kd) * command.velocity
        torque = np.clip(share * command.torque, -p.torque_limit, p.torque_limit)
        return LowCommand(SERVO, position, velocity, torque, np.full(12, kp), np.full(12, kd))


def _entered(memory: Memory, phase: Phase, heard: Heard) -> Memory:
    return replace(memory, phase=phase, since_ns=heard.now_ns)
