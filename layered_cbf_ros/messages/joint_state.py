"""sensor_msgs/JointState: named positions, velocities and efforts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layered_cbf_ros.errors import MessageError
from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.messages.cdr import (
    CdrReader,
    CdrWriter,
    FixedLayout,
    require_finite,
    stamp_of,
)

FIELDS = ('position', 'velocity', 'effort')


class JointStateWriter:
    """Encodes JointState messages with a fixed list of names."""

    def __init__(self, names: Sequence[str], frame_id: str = '') -> None:
        writer = CdrWriter()
        writer.header(frame_id)
        writer.texts(names)
        for _ in FIELDS:
            writer.doubles(len(names))
        self._layout = FixedLayout(writer.data, writer.blocks)

    def encode(self, stamp_ns: int, position: Array, velocity: Array, effort: Array) -> bytes:
        """Return the message; each array has one value a name."""
        return self._layout.encode(stamp_ns, position, velocity, effort)


class JointStateReader:
    """Picks the values of some names out of JointState messages.

    The names may stand anywhere in the message, in any order. Where they stand is
    learned from a message that looks unlike the one before, so that a steady
    sender costs only a comparison.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._layout: FixedLayout | None = None
        self._index = np.empty(0, dtype=np.intp)

    def read(self, data: bytes) -> tuple[int, Array]:
        """Return the stamp [ns] and position, velocity, effort of the names, (3, n).

        Raises:
            MessageError: If the message is malformed, lacks a name or is not finite.
        """
        layout = self._layout
        if layout is None or not layout.fits(data):
            layout = self._learn(data)
        values = np.empty((3, len(self._names)))
        for row, block in zip(values, layout.arrays(data), strict=True):
            block.take(self._index, out=row)
        require_finite(values, 'joint state')
        return stamp_of(data), values

    def _learn(self, data: bytes) -> FixedLayout:
        reader = CdrReader(data)
        reader.header()
        names = reader.texts()
        for field in FIELDS:
            length = len(reader.doubles())
            if length != len(names):
                raise MessageError(f'joint state has {len(names)} names but {length} of {field}')
        place = {name: i for i, name in enumerate(names)}
        missing = [name for name in self._names if name not in place]
        if missing:
            raise MessageError(f"joint state has no '{missing[0]}'")
        self._index = np.array([place[name] for name in self._names])
        self._layout = FixedLayout(data, reader.blocks)
        return self._layout
