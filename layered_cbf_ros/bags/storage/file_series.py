"""The mcap files of a bag that is being written, one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from layered_cbf_ros.bags.storage.bag_folder import BagFolder, path_of, write_error
from layered_cbf_ros.bags.storage.mcap_file import McapFile
from layered_cbf_ros.bags.storage.metadata import FilePart
from layered_cbf_ros.bags.storage.presets import Storage, preset_of


class FileSeries:
    """`<name>_0.mcap`, `<name>_1.mcap`, ... in their folder, each complete in itself.

    Attributes:
        folder: The folder.
        current: The file in progress.
    """

    def __init__(self, folder: Path, storage: Storage) -> None:
        """Make the folder and the first file.

        Raises:
            BagError: If they can't be made.
        """
        self._preset = preset_of(storage.preset)
        self._name = folder.name
        self._finished: list[FilePart] = []
        self._counts: Counter[int] = Counter()
        self.folder = BagFolder(folder, storage.force)
        self.current = self._begin()

    @property
    def parts(self) -> list[FilePart]:
        """Return what is on the disk by now, file by file."""
        return [*self._finished, self.current.part]

    @property
    def counts(self) -> Counter[int]:
        """Return the messages that are on the disk by now, by channel."""
        return self._counts + self.current.index.counts

    def finish(self, notes: Mapping[str, Mapping[str, str]]) -> None:
        """Write the end of the file in progress, unless it has one.

        Args:
            notes: Texts to store in it, by name and key.

        Raises:
            OSError: If it doesn't fit on the disk.
        """
        if self.current.is_finished:
            return
        for name, entries in notes.items():
            self.current.add_note(name, entries)
        self.current.finish()

    def begin_next(self) -> None:
        """Go on in another file; the one in progress is finished.

        Raises:
            BagError: If it can't be made.
        """
        following = self._begin(len(self._finished) + 1)
        self._finished.append(self.current.part)
        self._counts += self.current.index.counts
        self.current.close()
        self.current = following

    def keep(self) -> str:
        """See that nobody has deleted the file in progress, see BagFolder.keep."""
        return self.folder.keep(self.current.name, self.current.descriptor)

    def close(self) -> None:
        """Let file and folder go."""
        self.current.close()
        self.folder.close()

    def _begin(self, number: int = 0) -> McapFile:
        name = f'{self._name}_{number}.mcap'
        descriptor = self.folder.create(name)
        try:
            return McapFile(name, descriptor, self._preset)
        except OSError as error:
            raise write_error(path_of(descriptor), error) from None
