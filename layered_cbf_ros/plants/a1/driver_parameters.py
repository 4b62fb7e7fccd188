"""Parameters of the driver of one A1; values in params/a1_driver.yaml."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.parameters import parameter


@dataclass(frozen=True)
class DriverParameters:
    """Where the robot is, how it is stood up and held, and what is never allowed."""

    address: str = parameter('192.168.123.10', 'IP address of the robot')
    port: int = parameter(8007, 'UDP port of the robot', '', 1, 65535)
    local_port: int = parameter(8080, 'our own UDP port; the robot answers to it', '', 0, 65535)
    arm_at_start: bool = parameter(False, 'arm unasked; only if the address is this computer')
    listen_only: bool = parameter(False, 'send nothing, ever; tell what is heard')
    dry_run: bool = parameter(False, 'publish what would be sent, and send nothing')

    kp: float = parameter(0.0, 'stiffness added to commanded torques', 'Nm/rad', 0.0, 200.0)
    kd: float = parameter(0.0, 'damping added to commanded torques', 'Nm s/rad', 0.0, 10.0)
    stand_kp: float = parameter(100.0, 'stiffness of held poses', 'Nm/rad', 10.0, 200.0)
    stand_kd: float = parameter(3.0, 'damping of held poses', 'Nm s/rad', 0.5, 10.0)
    damping: float = parameter(3.0, 'damping that protects', 'Nm s/rad', 0.5, 10.0)
    com_height: float = parameter(0.26, 'CoM height of the standing pose', 'm', 0.15, 0.35)
    folded_thigh: float = parameter(
        1.3, 'thigh angle of the folded pose; the calves have -2 times that', 'rad', 1.0, 1.33
    )

    needed_states: int = parameter(50, 'valid states before the robot stands up', '', 1, 1000)
    answer_timeout: float = parameter(3.0, 'how long an armed robot may not answer', 's', 0.1, 60.0)
    fold_time: float = parameter(1.0, 'time to fold the legs before standing up', 's', 0.2, 10.0)
    stand_up_time: float = parameter(2.0, 'time to stand up from there', 's', 0.5, 10.0)
    takeover_time: float = parameter(
        0.2, 'time over which commanded torques replace the held pose', 's', 0.01, 2.0
    )
    takeover_share: float = parameter(
        0.5, 'share of the holding torques that a controller has to carry first', '', 0.0, 1.0
    )
    sit_down_time: float = parameter(2.0, 'time to sit down', 's', 0.5, 10.0)
    damped_time: float = parameter(1.5, 'damping before motors are switched off', 's', 1.0, 5.0)
    off_time: float = parameter(0.1, 'how long they are told to be off', 's', 0.01, 1.0)

    command_timeout: float = parameter(0.02, 'oldest joint command that acts', 's', 0.002, 0.2)
    state_timeout: float = parameter(0.02, 'longest silence of the robot', 's', 0.002, 0.2)
    tilt: float = parameter(60.0, 'largest tilt of the trunk', 'deg', 5.0, 90.0)
    joint_margin: float = parameter(
        0.087, 'how near to its limit a joint may come', 'rad', 0.0, 0.3
    )
    stop_margin: float = parameter(
        0.1, 'how far beyond its limit a joint of a lying robot may read', 'rad', 0.0, 0.5
    )
    torque_limit: float = parameter(33.5, 'largest torque that is commanded', 'Nm', 0.1, 33.5)
    torque: float = parameter(35.0, 'largest torque that a joint may report', 'Nm', 0.1, 127.0)
    speed: float = parameter(21.0, 'largest joint speed', 'rad/s', 0.1, 50.0)
    power_factor: float = parameter(4.0, 'largest power of all joints', '100 W', 0.1, 10.0)
    forgiven_states: int = parameter(
        5, 'states over the limit of torque, speed or power that are let pass', '', 0, 100
    )
    temperature: int = parameter(80, 'hottest motor', 'degC', 20, 127)

    def __post_init__(self) -> None:
        """Refuse what contradicts itself.

        Raises:
            ParameterError: If there is no such address, or a real robot would be armed unasked.
        """
        try:
            address = ipaddress.IPv4Address(self.address)
        except ValueError:
            raise ParameterError(
                f"a1_driver: address is '{self.address}'; give an IPv4 address, as 192.168.123.10"
            ) from None
        if self.arm_at_start and not address.is_loopback:
            raise ParameterError(
                f'a1_driver: arm_at_start is true, but {self.address} is not this computer; '
                'a real robot is armed by a person who looks: call ~/arm'
            )
        if self.arm_at_start and self.listen_only:
            raise ParameterError('a1_driver: listen_only sends nothing; set arm_at_start to false')
