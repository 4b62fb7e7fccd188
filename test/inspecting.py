"""Runs the program `inspect` in the test's own process, and packs bags for it by hand."""

from __future__ import annotations

import struct
from pathlib import Path

from test_bags import HEAD, TAIL, chunk, record, text

LATE_NS = 1_700_000_000 * 10**9
HEADER = 'std_msgs/msg/Header'
CLOCK = 'rosgraph_msgs/msg/Clock'
TIME_FIELDS = 'MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'
RULE = '=' * 80 + '\n'
DEFINITIONS = {
    HEADER: f'builtin_interfaces/Time stamp\nstring frame_id\n{RULE}{TIME_FIELDS}',
    CLOCK: f'builtin_interfaces/Time clock\n{RULE}{TIME_FIELDS}',
    'std_msgs/msg/String': 'string data\n',
}


class Ended:
    """How the program ended: exit code, and what it printed."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code = code
        self.out = out
        self.err = err

    @property
    def problem(self) -> str:
        """The one line on standard error."""
        (line,) = self.err.splitlines()
        return line


class Inspector:
    """Calls the program as often as asked."""

    def __init__(self, monkeypatch, capsys) -> None:
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *arguments: str | Path) -> Ended:
        from layered_cbf_ros.nodes.inspect import main

        self._monkeypatch.setattr('sys.argv', ['inspect', *map(str, arguments)])
        self._capsys.readouterr()
        try:
            main()
        except SystemExit as ended:
            return Ended(ended.code, *self._capsys.readouterr())
        raise AssertionError('the program did not end')


def topic(
    number: int, name: str, kind: str, definition: str | None = None, digest: str = ''
) -> bytes:
    """Pack schema and channel of a topic."""
    known = DEFINITIONS.get(kind, '') if definition is None else definition
    schema = struct.pack('<H', number) + text(kind) + text('ros2msg' if known else '') + text(known)
    entries = text('topic_type_hash') + text(digest)
    channel = struct.pack('<HH', number, number) + text(name) + text('cdr')
    channel += struct.pack('<I', len(entries)) + entries
    return record(3, schema) + record(4, channel)


def stamped(number: int, stamp_ns: int, log_ns: int, frame: str | None = None) -> bytes:
    """Pack a message of a topic of type HEADER, or CLOCK without a frame."""
    data = b'\0\1\0\0' + struct.pack('<iI', *divmod(stamp_ns, 10**9))
    if frame is not None:
        data += struct.pack('<I', len(frame) + 1) + frame.encode() + b'\0'
    return message(number, log_ns, data)


def message(number: int, log_ns: int, data: bytes) -> bytes:
    """Pack a message."""
    return record(5, struct.pack('<HIQQ', number, 0, LATE_NS + log_ns, LATE_NS + log_ns) + data)


def note(name: str, entries: dict[str, str]) -> bytes:
    """Pack a Metadata record."""
    packed = b''.join(text(key) + text(value) for key, value in entries.items())
    return record(12, text(name) + struct.pack('<I', len(packed)) + packed)


def write(path: Path, *parts: bytes, notes: bytes = b'') -> Path:
    """Write an mcap file with one chunk."""
    path.write_bytes(HEAD + chunk(b''.join(parts), 'lz4') + notes + TAIL)
    return path
