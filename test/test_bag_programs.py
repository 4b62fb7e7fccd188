"""What all programs for bags have in common: a bad bag is one clear line, and exit code 2."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from test_bags import CHANNEL, HEAD, TAIL, chunk, string_message

pytest.importorskip('rclpy', reason='rclpy, which replay publishes with, is not installed')

PROGRAMS = {
    'audit': [],
    'inspect': [],
    're_solve': [],
    'replay': ['--disable-keyboard-controls'],
}
LIMIT_S = 60.0


def run(program: str, *arguments: str | Path) -> subprocess.CompletedProcess:
    code = f'from layered_cbf_ros.nodes.{program} import main; main()'
    return subprocess.run(
        [sys.executable, '-c', code, *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        stdin=subprocess.DEVNULL,
    )


def bad_bag(folder: Path, kind: str) -> Path:
    path = folder / kind
    if kind == 'folder':
        path.mkdir()
    elif kind == 'empty':
        path.touch()
    elif kind == 'text':
        path.write_text('a bag of words\n')
    elif kind == 'half_a_head':
        path.write_bytes(HEAD[:12])
    elif kind == 'spoilt_sqlite':
        path.write_bytes(b'SQLite format 3\0' + bytes(4096))
    return path


@pytest.mark.parametrize(
    'kind', ['absent', 'folder', 'empty', 'text', 'half_a_head', 'spoilt_sqlite']
)
@pytest.mark.parametrize('program', PROGRAMS)
def test_what_is_no_bag_is_refused_in_one_line(tmp_path, program, kind):
    path = bad_bag(tmp_path, kind)
    before = sorted(tmp_path.rglob('*'))
    ended = run(program, path, *PROGRAMS[program])
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert str(path) in line
    assert sorted(tmp_path.rglob('*')) == before


@pytest.mark.parametrize('program', ['audit', 're_solve'])
def test_a_bag_of_something_else_proves_nothing(tmp_path, program):
    path = tmp_path / 'other.mcap'
    path.write_bytes(HEAD + chunk(CHANNEL + string_message(1, 'one'), 'lz4') + TAIL)
    ended = run(program, path)
    assert ended.returncode == 2
    assert '/scenario' in ended.stdout + ended.stderr
    assert 'Traceback' not in ended.stderr


@pytest.mark.parametrize('program', PROGRAMS)
def test_help_tells_every_exit_code_or_flag(program):
    ended = run(program, '--help')
    assert ended.returncode == 0
    assert ended.stdout.startswith(f'usage: {program}')
    assert ended.stderr == ''


@pytest.mark.parametrize('program', PROGRAMS)
def test_an_unknown_flag_is_named(tmp_path, program):
    ended = run(program, tmp_path, '--no-such-flag')
    assert ended.returncode == 2
    assert '--no-such-flag' in ended.stderr.splitlines()[-1]
