"""What a killed process leaves in /dev/shm.

Fast DDS gives each participant a memory segment and a port, and guards each with a
lock file that ends in `_el`. A participant that is killed can't remove them. Only
files that we saw one of our own children hold are removed, and only if nobody
holds their lock any more; and ports of our own domain that nobody maps any more.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable
from pathlib import Path

FOLDER = Path('/dev/shm')
PREFIXES = ('fastrtps_', 'fastdds_')
LOCK_SUFFIX = '_el'
PORT_BASE, PORTS_PER_DOMAIN = 7400, 250  # of the DDS standard


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


def remove_ports(domain: int) -> int:
    """Remove the ports of a domain that no process has in its memory; return how many."""
    first = PORT_BASE + PORTS_PER_DOMAIN * domain
    names = [f'fastrtps_port{first + k}' for k in range(PORTS_PER_DOMAIN)]
    ports = [FOLDER / name for name in names if (FOLDER / name).exists()]
    used = _mapped() if ports else frozenset()
    free = [port for port in ports if port not in used]
    for port in free:
        _unlink_all(port.name)
    return len(free)


def _mapped() -> frozenset[Path]:
    """Return the files of FOLDER that processes have in their memory."""
    found = set()
    for process in Path('/proc').glob('[0-9]*'):
        try:
            lines = (process / 'maps').read_text().splitlines()
        except OSError:  # it has ended, or is somebody else's
            continue
        found |= {Path(line[line.index('/') :]) for line in lines if f' {FOLDER}/' in line}
    return frozenset(found)


def _unlink_all(segment: str) -> None:
    """Remove a segment with its mutex and its lock file."""
    for name in (segment, f'sem.{segment}_mutex', f'{segment}{LOCK_SUFFIX}'):
        (FOLDER / name).unlink(missing_ok=True)


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
        _unlink_all(lock.name[: -len(LOCK_SUFFIX)])
        return True
    finally:
        os.close(descriptor)
