"""The folder of a bag that is being written, held fast whatever others do with it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from pathlib import Path

from layered_cbf_ros.errors import BagError

DELETED = ' (deleted)'
"""What Linux says behind the name of an open file or folder that is no longer there."""


def path_of(descriptor: int) -> str:
    """Return where an open file or folder is now, or was before it was deleted."""
    return os.readlink(f'/proc/self/fd/{descriptor}').removesuffix(DELETED)


def write_error(path: str, error: OSError, more: str = '') -> BagError:
    """Return an error that names the file, what is wrong with it, more, and the remedy."""
    try:
        free = f'; {shutil.disk_usage(os.path.dirname(path)).free >> 10} KiB are free there'
    except OSError:
        free = ''
    return BagError(
        f'{path} cannot be written: {error.strerror}{free}; {more}'
        'make room, or record to another disk with --output'
    )


class BagFolder:
    """A folder, by its descriptor: renamed or moved, it is still the same one."""

    def __init__(self, path: Path, force: bool = False) -> None:
        """Make the folder.

        Args:
            path: Where; nothing or an empty folder may be there.
            force: Remove a bag that is there.

        Raises:
            BagError: If something is there, or it can't be made.
        """
        self._name = path.name
        try:
            if path.exists() and any(path.iterdir()):
                if not (force and is_bag(path)):
                    hint = 'it is no bag, so remove it yourself' if force else '--force replaces it'
                    raise BagError(f'{path} exists already; choose another --output ({hint})')
                shutil.rmtree(path)
            path.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            raise BagError(
                f'{path} cannot be written: {error.strerror}; choose another --output'
            ) from None

    @property
    def path(self) -> str:
        """Return where the folder is now."""
        return path_of(self._descriptor)

    def create(self, name: str) -> int:
        """Create a file; return its descriptor.

        Raises:
            BagError: If it can't be.
        """
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        try:
            descriptor = os.open(name, flags, 0o644, dir_fd=self._descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # nobody repairs it meanwhile
        except OSError as error:
            raise write_error(f'{self.path}/{name}', error) from None
        return descriptor

    def replace(self, name: str, text: str) -> None:
        """Write a small file, whole or not at all: a reader never sees half of it.

        Raises:
            OSError: If it can't be written; what was there before is left.
        """
        replace_file(name, text, self._descriptor)

    def keep(self, name: str, descriptor: int) -> str:
        """See that the folder and the file in progress still exist; put back what doesn't.

        Args:
            name: Name of the file.
            descriptor: The file.

        Returns:
            What was done, in words; '' if all is there.

        Raises:
            BagError: If it can't be put back.
        """
        if os.fstat(descriptor).st_nlink:
            return ''
        try:
            if not os.fstat(self._descriptor).st_nlink:
                os.makedirs(self.path, exist_ok=True)
                folder = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
                os.dup2(folder, self._descriptor, inheritable=False)
                os.close(folder)
        except OSError as error:
            raise BagError(
                f'{self.path} was deleted while recording and cannot be put back: {error.strerror}'
            ) from None
        copy = self.create(name)
        try:
            _copy(descriptor, copy)
        except OSError as error:
            raise write_error(path_of(copy), error) from None
        os.dup2(copy, descriptor, inheritable=False)
        os.close(copy)
        return f'{path_of(descriptor)} was deleted while recording; it was put back'

    def close(self) -> None:
        """Let the folder go."""
        os.close(self._descriptor)


def is_bag(folder: Path) -> bool:
    """Tell whether a folder holds a bag and nothing else."""
    return all(
        entry.is_file() and (entry.name == 'metadata.yaml' or entry.suffix in ('.mcap', '.db3'))
        for entry in folder.iterdir()
    )


def replace_file(name: str, text: str, folder: int | None = None) -> None:
    """Write a small file, whole or not at all.

    Args:
        name: Its name in the folder, or its path without one.
        text: What is in it.
        folder: Descriptor of the folder.

    Raises:
        OSError: If it can't be written; what was there before is left.
    """
    unfinished = f'{name}.tmp'
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
    try:
        with open(os.open(unfinished, flags, 0o644, dir_fd=folder), 'w', encoding='utf-8') as file:
            file.write(text)
        os.replace(unfinished, name, src_dir_fd=folder, dst_dir_fd=folder)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(unfinished, dir_fd=folder)
        raise


def _copy(source: int, target: int) -> None:
    """Copy a file, and stand behind its end in the copy."""
    done, size = 0, os.fstat(source).st_size
    while done < size:
        done += os.sendfile(target, source, done, size - done)
    os.lseek(target, 0, os.SEEK_END)
