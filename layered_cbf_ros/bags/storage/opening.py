"""Opens a bag, whoever recorded it."""

from __future__ import annotations

from pathlib import Path

from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.foreign import ForeignBag
from layered_cbf_ros.bags.storage.mcap_records import MAGIC
from layered_cbf_ros.bags.storage.reader import BagReader
from layered_cbf_ros.errors import BagError

SQLITE_MAGIC = b'SQLite format 3\0'


def open_bag(path: Path) -> Bag:
    """Return a bag.

    Args:
        path: An mcap or db3 file, a bag's folder, or a run's folder with the bag in bag/.

    Raises:
        BagError: If there is no bag, in one line that tells what is there instead.
    """
    if not path.exists():
        raise BagError(f'{path} does not exist; give a bag: a folder, an mcap or a db3 file')
    if path.is_file():
        return _open_file(path)
    folder = path / 'bag' if (path / 'bag').is_dir() else path
    if any(folder.glob('*.mcap')):
        return BagReader(folder)
    if (folder / 'metadata.yaml').exists() or any(folder.glob('*.db3')):
        return ForeignBag(folder)
    raise BagError(f'{path} is no bag: it holds neither mcap nor db3 files')


def _open_file(path: Path) -> Bag:
    try:
        with path.open('rb') as stream:
            beginning = stream.read(len(SQLITE_MAGIC))
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error.strerror}') from None
    if not beginning:
        raise BagError(f'{path} is empty; nothing was recorded into it')
    if beginning.startswith(SQLITE_MAGIC):
        return ForeignBag(path)
    if not MAGIC.startswith(beginning[: len(MAGIC)]):
        raise BagError(f'{path} is no bag: it begins neither like mcap nor like sqlite3')
    return BagReader(path)
