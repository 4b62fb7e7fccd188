"""How a joystick is read, named as teleop_twist_joy names it; values in params/joystick/."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.parameters import parameter

OFF = -1
"""The number of an axis or a button that a pad doesn't have."""

LAST = 63  # highest number of an axis or a button


def _axis(default: int, description: str, name: str) -> int:
    number: int = parameter(default, f'{description}; -1: none.', '', OFF, LAST, name=name)
    return number


def _button(default: int, description: str) -> int:
    number: int = parameter(default, f'{description}; -1: none.', '', OFF, LAST)
    return number


@dataclass(frozen=True)
class JoystickParameters:
    """Axes, buttons and scales; the defaults are those of an Xbox pad.

    Axes count to the left and forward, as ROS's joy_node sends them.
    """

    axis_linear_x: int = _axis(1, 'Axis of the velocity forward', 'axis_linear.x')
    axis_linear_y: int = _axis(0, 'Axis of the velocity to the left', 'axis_linear.y')
    axis_angular_yaw: int = _axis(3, 'Axis of the yaw rate', 'axis_angular.yaw')
    scale_linear_x: float = parameter(
        0.35, 'Velocity forward at full stick.', 'm/s', -3.0, 3.0, name='scale_linear.x'
    )
    scale_linear_y: float = parameter(
        0.25, 'Velocity to the left at full stick.', 'm/s', -3.0, 3.0, name='scale_linear.y'
    )
    scale_angular_yaw: float = parameter(
        0.6, 'Yaw rate at full stick.', 'rad/s', -5.0, 5.0, name='scale_angular.yaw'
    )
    scale_linear_turbo_x: float = parameter(
        0.5, 'The same with the turbo button.', 'm/s', -3.0, 3.0, name='scale_linear_turbo.x'
    )
    scale_linear_turbo_y: float = parameter(
        0.35, 'The same with the turbo button.', 'm/s', -3.0, 3.0, name='scale_linear_turbo.y'
    )
    scale_angular_turbo_yaw: float = parameter(
        1.0, 'The same with the turbo button.', 'rad/s', -5.0, 5.0, name='scale_angular_turbo.yaw'
    )
    deadzone: float = parameter(0.1, 'Share of an axis that counts as zero.', '', 0.0, 0.9)
    require_enable_button: bool = parameter(
        True, 'Nobody moves without the enable button; it is always required.'
    )
    enable_button: int = parameter(4, 'To be held while steering (dead-man).', '', 0, LAST)
    enable_turbo_button: int = _button(5, 'To be held besides for the turbo scales')
    e_stop_button: int = parameter(1, 'Emergency stop of all robots.', '', 0, LAST)
    reset_button: int = _button(7, 'To be held alone for a second to end an emergency stop')
    next_robot_button: int = _button(3, 'Steer the next robot, alone')
    all_button: int = _button(2, 'Steer all robots, each by its own heading')
    formation_button: int = _button(
        0, "Steer all robots with the same velocity, by the first one's heading"
    )
    release_button: int = _button(6, 'Give all robots back to their own goals')
    joy_timeout: float = parameter(
        0.15, 'Silence after which a joystick counts as released.', 's', 0.02, 1.0
    )
    cmd_vel_timeout: float = parameter(
        0.15, "Silence after which a planner's robot stops.", 's', 0.02, 1.0
    )
    linear_rate_limit: float = parameter(
        1.5, 'Fastest growth of a commanded velocity; it ends at once.', 'm/s^2', 0.1, 20.0
    )
    angular_rate_limit: float = parameter(
        3.0, 'Fastest growth of a commanded yaw rate.', 'rad/s^2', 0.1, 50.0
    )

    def __post_init__(self) -> None:
        """Refuse what would let robots move without a hand on the pad.

        Raises:
            ParameterError: If the enable button isn't required, or is something else too.
        """
        if not self.require_enable_button:
            raise ParameterError(
                'JoystickParameters.require_enable_button is False; robots are steered with a '
                'dead-man button only: say true'
            )
        for name in ('enable_button', 'e_stop_button'):
            number = getattr(self, name)
            same = [other for other in _BUTTONS if getattr(self, other) == number]
            if len(same) > 1:
                raise ParameterError(
                    f'JoystickParameters.{same[0]} and {same[1]} are both {number}; '
                    'give each a button of its own'
                )


_BUTTONS = (
    *('enable_button', 'enable_turbo_button', 'e_stop_button', 'reset_button'),
    *('next_robot_button', 'all_button', 'formation_button', 'release_button'),
)
