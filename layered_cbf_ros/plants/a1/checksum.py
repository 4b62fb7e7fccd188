"""The checksum of an A1's packets: CRC-32/MPEG-2 over 32-bit words, each taken high byte first.

The same number comes out of zlib's CRC, which takes each byte low bit first, when it is
fed the bytes in the words' order with their bits reversed; a loop in Python would take
longer than a cycle of the robot.
"""

from __future__ import annotations

import zlib

import numpy as np

REVERSED = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))
"""Each byte with its bits in reverse order."""


def checksum(data: bytes | bytearray | memoryview) -> int:
    """Return the checksum of whole little-endian words; bytes beyond the last one are left out.

    Polynomial 0x04C11DB7, initial value 0xFFFFFFFF, no reflection, no final inversion.
    """
    words = np.frombuffer(data, '<u4', len(data) >> 2)
    mirrored = words.byteswap().tobytes().translate(REVERSED)
    crc = zlib.crc32(mirrored) ^ 0xFFFFFFFF
    return int.from_bytes(crc.to_bytes(4, 'little').translate(REVERSED), 'big')
