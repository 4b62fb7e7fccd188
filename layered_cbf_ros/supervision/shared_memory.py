"""What a killed process leaves in /dev/shm.

Fast DDS gives each participant a memory segment and a port, and guards each with a
lock file that ends in `_el`. A participant that is killed can't remove them. Only
files that we saw one of our own children hold are removed, and only if nobody
holds their lock any more.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable
from pathlib import Path

FOLDER = Path('/dev/shm')
PREFIXES = ('fastrtps_', 'fastdds_')
LOCK_SUFFIX = '_el'


def held_by(pid: int) -> frozenset[Path]:
    """Return the lock files of Fast DDS that a process has open."""
    held = set()
    try:
        descriptors = list(Path(f'/proc/{pid}/fd').iterdir())
    except OSError:  # it has ended
        return frozenset()
    for descriptor in descriptors:
        try:
            target = descriptor.readlink()
        except OSError:
            continue
        if _is_lock(target):
            held.add(target)
    return frozenset(held)


def remove(locks: Iterable[Path]) -> int:
    """Remove the segments of these lock files that nobody holds; return how many."""
    return sum(_remove_if_free(lock) for lock in locks if _is_lock(lock))


def _is_lock(path: Path) -> bool:
    name = path.name
    return path.parent == FOLDER and name.startswith(PREFIXES) and name.endswith(LOCK_SUFFIX)


def _remove_if_free(lock: Path) -> bool:
    try:
        descriptor = os.open(lock, os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    else:
        segment = lock.name[: -len(LOCK_SUFFIX)]
        for name in (segment, f'sem.{segment}_mutex', lock.name):
            lock.with_name(name).unlink(missing_ok=True)
        return True
    finally:
        os.close(descriptor)
