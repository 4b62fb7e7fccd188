"""Where the links of an A1 are: what a tool that knows its description needs to show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from layered_cbf_ros.interfaces import LEGS, Array
from layered_cbf_ros.robot_model import find_urdf

CHAIN = ('hip', 'upper', 'lower', 'toe')
"""Links of a leg whose origins, one after the other, draw it."""


@dataclass(frozen=True, slots=True)
class LinkPose:
    """Pose of a link in the frame of its parent.

    Attributes:
        parent: Name of the parent link; empty for the world.
        link: Its name.
        position: [m], (3,).
        quaternion: x, y, z, w, (4,).
    """

    parent: str
    link: str
    position: Array
    quaternion: Array


class Links:
    """Forward kinematics of the whole description, link by link."""

    def __init__(self) -> None:
        """Read the description.

        Raises:
            ParameterError: If it is absent.
        """
        self._model = model = pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())
        self._data = model.createData()
        frames = model.frames
        bodies = [k for k, frame in enumerate(frames) if frame.type == pin.FrameType.BODY]
        self._tree = [(frames[frames[k].parentFrame].parentFrame, k) for k in bodies]
        self._chains = [[model.getFrameId(f'{leg}_{part}') for part in CHAIN] for leg in LEGS]

    def tree(self, configuration: Array) -> list[LinkPose]:
        """Return the pose of every link in its parent, the base in the world.

        Args:
            configuration: As in RobotState, (19,).
        """
        self._place(configuration)
        poses = []
        for parent, link in self._tree:
            relative = self._data.oMf[parent].actInv(self._data.oMf[link])
            numbers = pin.SE3ToXYZQUAT(relative)
            above = '' if parent == 0 else self._model.frames[parent].name
            name = self._model.frames[link].name
            poses.append(LinkPose(above, name, numbers[:3], numbers[3:]))
        return poses

    def legs(self, configuration: Array) -> Array:
        """Return the origins of the links of each leg in the world [m], (4, 4, 3).

        Args:
            configuration: As in RobotState, (19,).
        """
        self._place(configuration)
        places = [[self._data.oMf[k].translation for k in chain] for chain in self._chains]
        return np.array(places)

    def _place(self, configuration: Array) -> None:
        pin.framesForwardKinematics(self._model, self._data, configuration)
