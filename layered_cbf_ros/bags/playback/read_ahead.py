"""Reads a bag ahead of its replay: unpacking a chunk takes longer than messages may wait."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from queue import Empty, Full, Queue

from layered_cbf_ros.bags.storage.topic import Record

BATCH = 256  # messages; fewer, if they are large
BATCH_BYTES = 1 << 20
BATCHES = 16
PATIENCE_S = 0.1


class ReadAhead:
    """Iterates over records that a thread of its own reads, a few thousand or 16 MiB ahead."""

    def __init__(self, source: Iterator[Record]) -> None:
        """Begin to read.

        Args:
            source: What to iterate over; what it raises, the iteration here raises.
        """
        self._batches: Queue[list[Record] | BaseException] = Queue(BATCHES)
        self._closed, self._filled = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._read, args=(source,), daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Record]:
        while True:
            batch = self._batches.get()
            if isinstance(batch, BaseException):
                raise batch
            if not batch:
                return
            yield from batch

    def wait_until_filled(self) -> None:
        """Wait until the first items, if there are any, are there."""
        self._filled.wait()

    def close(self) -> None:
        """Stop reading."""
        self._closed.set()
        while self._thread.is_alive():
            try:
                self._batches.get(timeout=PATIENCE_S)
            except Empty:
                continue
        self._thread.join()

    def _read(self, source: Iterator[Record]) -> None:
        batch: list[Record] = []
        ending: list[Record] | BaseException = []
        size = 0
        try:
            for record in source:
                batch.append(record)
                size += len(record.data)
                if len(batch) == BATCH or size >= BATCH_BYTES:
                    if not self._put(batch):
                        return
                    batch, size = [], 0
        except Exception as error:  # whatever it is: the thread that iterates must hear of it
            ending = error
        if batch:
            self._put(batch)
        self._put(ending)

    def _put(self, batch: list[Record] | BaseException) -> bool:
        """Hand a batch over as soon as there is room; return False if nobody wants it."""
        while not self._closed.is_set():
            try:
                self._batches.put(batch, timeout=PATIENCE_S)
            except Full:
                continue
            self._filled.set()
            return True
        return False
