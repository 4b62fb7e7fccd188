"""Writes messages as tables, a file a topic, without ever holding many of them."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from layered_cbf_ros.bags.inspection.cells import Messages
from layered_cbf_ros.bags.inspection.columns import RowPlan
from layered_cbf_ros.bags.inspection.layout import lay_out
from layered_cbf_ros.bags.inspection.selection import Selection
from layered_cbf_ros.bags.inspection.tables import FORMATS, Table, require_pyarrow
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.decoding import typestore_of
from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError

TOGETHER = 1 << 20
"""Messages of a topic are written together once they have so many bytes."""

MOST_TABLES = 50
"""A topic whose messages look so different that it needs more files is given up."""

KEPT_PLANS = 64


class TopicExport:
    """Writes one topic: `<topic>.csv`, and `<topic>.2.csv` for messages with other columns.

    Messages that aren't what their type says are left out; a survey tells of them.

    Attributes:
        files: The files written.
        left_out: Messages that are in no file because there would be too many files.
    """

    def __init__(self, topic: Topic, kind: str, folder: Path) -> None:
        """Begin.

        Args:
            topic: The topic.
            kind: 'csv' or 'parquet'.
            folder: Where its files go.

        Raises:
            BagError: If the type of the topic isn't known.
        """
        self.files: list[Path] = []
        self.left_out = 0
        self._topic, self._kind, self._folder = topic, kind, folder
        self._store = typestore_of(topic)
        self._plans: dict[int, RowPlan] = {}
        self._tables: dict[tuple[str, ...], Table] = {}
        self._waiting: Messages | None = None

    def take(self, record: Record) -> None:
        """Take the next message."""
        plan = self._plans.get(len(record.data))
        if plan is None or not plan.fits(record.data):
            try:
                layout = lay_out(self._store, self._topic.type_name, record.data)
            except BagError:
                return
            if len(self._plans) >= KEPT_PLANS:
                self._plans.clear()
            plan = self._plans[len(record.data)] = RowPlan(layout, record.data)
        if self._waiting is None or self._waiting.plan is not plan:
            self._write_waiting()
            self._waiting = Messages(plan)
        self._waiting.add(record.data, record.log_time_ns, record.publish_time_ns)
        if self._waiting.size > TOGETHER:
            self._write_waiting()

    def close(self) -> None:
        """Write what waits, and end the files."""
        self._write_waiting()
        for table in self._tables.values():
            table.close()

    def _write_waiting(self) -> None:
        waiting, self._waiting = self._waiting, None
        for columns in [] if waiting is None else waiting.tables():
            table = self._table(tuple(columns))
            if table is None:
                self.left_out += len(columns['log_time_ns'])
            else:
                table.write(columns)

    def _table(self, labels: tuple[str, ...]) -> Table | None:
        """Return the file with these columns; None if there are too many already."""
        if labels not in self._tables:
            if len(self._tables) == MOST_TABLES:
                return None
            number = f'.{len(self._tables) + 1}' if self._tables else ''
            path = self._folder / f'{file_stem(self._topic.name)}{number}.{self._kind}'
            self._tables[labels] = FORMATS[self._kind](path)
            self.files.append(path)
        return self._tables[labels]


def export(bag: Bag, selection: Selection, kind: str, folder: Path) -> tuple[list[Path], list[str]]:
    """Write messages as tables.

    Args:
        bag: The bag.
        selection: Which messages.
        kind: 'csv' or 'parquet'.
        folder: Where the files go; made if it is absent.

    Returns:
        The files written, and what is wrong, a line each.

    Raises:
        BagError: If the bag lacks a topic or can't be read, or a file can't be written.
    """
    exports: dict[str, TopicExport | None] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for record in selection.records(bag):
            name = record.topic.name
            if name not in exports:
                exports[name] = _begun(record.topic, kind, folder)
            each = exports[name]
            if each is not None:
                each.take(record)
        done = {name: each for name, each in exports.items() if each is not None}
        for each in done.values():
            each.close()
    except OSError as error:
        raise BagError(f'{folder} cannot be written: {error.strerror}; make room') from None
    problems = [
        f'{name}: {each.left_out} rows are in no file: there are more than {MOST_TABLES} '
        'kinds of them; read this topic with --topic --json'
        for name, each in done.items()
        if each.left_out
    ]
    return [file for each in done.values() for file in each.files], problems


def _begun(topic: Topic, kind: str, folder: Path) -> TopicExport | None:
    """Begin to export a topic; None if its type isn't known, of which a survey tells."""
    try:
        return TopicExport(topic, kind, folder)
    except BagError:
        return None


def check_tables(folder: Path, topics: Collection[str], kind: str, force: bool) -> None:
    """Make sure that nothing is overwritten; with force, remove what an older export left.

    Args:
        folder: Where files will go.
        topics: Names of the topics.
        kind: 'csv' or 'parquet'.
        force: Whether the user wants it.

    Raises:
        BagError: If a file is there and there is no force, or pyarrow is needed and absent.
    """
    if kind == 'parquet':
        require_pyarrow()
    if folder.exists() and not folder.is_dir():
        raise BagError(f'{folder} is no folder; choose another --output')
    stems = '|'.join(re.escape(file_stem(topic)) for topic in topics)
    pattern = re.compile(rf'({stems})(\.\d+)?\.{kind}')
    found = [path for path in sorted(folder.glob(f'*.{kind}')) if pattern.fullmatch(path.name)]
    if found and not force:
        raise BagError(f'{found[0]} exists already; choose another --output, or --force')
    for path in found:
        path.unlink()


def file_stem(topic: str) -> str:
    """Return the name of a topic's file: `/a1_0/odom` becomes `a1_0.odom`."""
    return topic.strip('/').replace('/', '.') or 'topic'
