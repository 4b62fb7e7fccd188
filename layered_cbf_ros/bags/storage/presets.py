"""How a bag is stored: compression, checksums, sizes."""

from __future__ import annotations

from dataclasses import dataclass

from layered_cbf_ros.errors import BagError

CHUNK_BYTES = 1 << 20
ZSTD_FAST, ZSTD_SMALL = -5, 9  # beyond 9 one core can't keep up with what robots send


@dataclass(frozen=True, slots=True)
class Preset:
    """How chunks are stored.

    Attributes:
        compression: Its name in the file, '' for none.
        level: How hard to try; only zstd has it.
        checksum: Whether each chunk gets one.
    """

    compression: str
    level: int = 0
    checksum: bool = True


PRESETS = {
    'lz4': Preset('lz4'),
    'none': Preset(''),
    'fastwrite': Preset('', checksum=False),
    'zstd_fast': Preset('zstd', ZSTD_FAST, checksum=False),
    'zstd_small': Preset('zstd', ZSTD_SMALL),
}
"""By name; all but lz4 are called as in rosbag2."""


def preset_of(name: str) -> Preset:
    """Return a preset.

    Raises:
        BagError: If there is none of this name.
    """
    if name not in PRESETS:
        raise BagError(f"storage preset is '{name}'; choose one of {', '.join(PRESETS)}")
    return PRESETS[name]


@dataclass(frozen=True, slots=True)
class Storage:
    """How a bag is stored.

    Attributes:
        preset: Name of a preset, see chunk.PRESETS.
        chunk_bytes: Size of a chunk before compression.
        max_bytes: Size at which the next file begins, 0 for never.
        max_seconds: Time after which the next file begins, 0 for never [s].
        force: Replace a bag that is there.
    """

    preset: str = 'none'
    chunk_bytes: int = CHUNK_BYTES
    max_bytes: int = 0
    max_seconds: float = 0.0
    force: bool = False
