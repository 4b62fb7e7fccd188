"""Make the virtual environment: choose a Python, run pip, lay out what ROS looks for."""

from __future__ import annotations

import configparser
import fcntl
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from environment import PACKAGE, ROOT, STAMP, SetupError, is_ready

UNFINISHED = 'layered_cbf_ros.unfinished'
LOG = 'layered_cbf_ros.setup.log'
VERSIONS = ((3, 10), (3, 11), (3, 12))
PYBULLET_WHEELS = VERSIONS[:2]
# What a Jazzy installation with the dependencies of package.xml may lack.
BESIDE_JAZZY = (
    *('lz4', 'matplotlib', 'mcap', 'pillow', 'pybullet', 'pyyaml', 'rosbags', 'zstandard'),
    *('aiohttp', 'imageio-ffmpeg', 'mcap-ros2-support', 'mypy', 'playwright'),
    *('pyarrow', 'pytest', 'pytest-xdist', 'ruff', 'viser'),
)
PROBE = """
import importlib.util, os, sys, sysconfig
print(*sys.version_info[:2], importlib.util.find_spec('ensurepip') is not None,
      os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')))
"""
# What pip prints when something outside this project is wrong, and what that means.
MEANINGS = (
    ('No space left on device', 'the disk is full'),
    ('ProxyError', 'the network proxy refuses the Python package index'),
    ('NewConnectionError', 'no network: the Python packages must be downloaded once'),
    ('Read timed out', 'the network is too slow; start again, what has arrived is kept'),
    (
        '(from versions: none)',
        'the package index is out of reach, or has nothing for this machine',
    ),
    ('Failed building wheel', 'a package could not be compiled'),
)


def install(venv: Path, wanted: str, jazzy: bool) -> None:
    """Make the environment complete; others that start meanwhile wait for it.

    A marker says that an installation was begun, so that one that was interrupted
    is never mistaken for a whole one.
    """
    try:
        venv.mkdir(parents=True, exist_ok=True)
        lock = os.open(str(venv), os.O_RDONLY)
    except OSError as error:
        raise SetupError(f'{venv} can not be made: {error.strerror}') from None
    try:
        _wait_for(lock)
        if is_ready(venv, wanted):
            return
        began = time.monotonic()
        print(f'setup: making {venv}, once', file=sys.stderr, flush=True)
        _make_venv(venv, jazzy)
        run_pip(venv, jazzy)
        lay_out(venv)
        (venv / UNFINISHED).unlink()
        (venv / STAMP).write_text(wanted)
        print(f'setup: done in {time.monotonic() - began:.0f} s', file=sys.stderr, flush=True)
    finally:
        os.close(lock)


def _wait_for(lock: int) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print('setup: another start is making the environment; waiting', file=sys.stderr)
        fcntl.flock(lock, fcntl.LOCK_EX)


def _make_venv(venv: Path, jazzy: bool) -> None:
    """Create the environment, or keep a sound one and only bring it up to date."""
    python = venv / 'bin' / 'python'
    sound = not (venv / UNFINISHED).exists() and python.exists() and probe(str(python))
    if (venv / STAMP).exists():
        (venv / STAMP).unlink()
    if not sound:
        chosen = choose_python(jazzy)
        options = ['--clear', *(['--system-site-packages'] if jazzy else [])]
        command = [chosen, '-m', 'venv', *options, str(venv)]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            lines = (made.stdout + made.stderr).strip().splitlines()
            raise SetupError(
                f'{chosen} -m venv failed: {lines[-1] if lines else "no reason given"}'
            )
    (venv / UNFINISHED).touch()


def probe(python: str) -> tuple[tuple[int, int], bool, bool] | None:
    """Return version, whether it can make a venv, whether it has C headers."""
    try:
        told = subprocess.run(
            [python, '-c', PROBE], capture_output=True, text=True, timeout=20, check=True
        ).stdout.split()
    except (OSError, subprocess.SubprocessError):
        return None
    version = (int(told[0]), int(told[1]))
    return (version, told[2] == 'True', told[3] == 'True') if version in VERSIONS else None


def choose_python(jazzy: bool) -> str:
    """Return the Python to build on: the running one if it will do, else one on PATH."""
    forced = os.environ.get('LAYERED_CBF_ROS_PYTHON')
    names = ['python3.11', 'python3.10', 'python3.12']
    candidates = [forced] if forced else [sys.executable, *filter(None, map(shutil.which, names))]
    if jazzy and not forced:
        candidates = ['/usr/bin/python3']
    known = [(python, probe(python)) for python in candidates]
    usable = [(python, *facts) for python, facts in known if facts]
    if not usable:
        mine = '.'.join(map(str, sys.version_info[:3]))
        raise SetupError(f'Python 3.10, 3.11 or 3.12 is needed; found {mine} ({sys.executable})')
    able = [entry for entry in usable if entry[2]]
    if not able:
        version = '.'.join(map(str, usable[0][1]))
        raise SetupError(f'{usable[0][0]} has no venv module: apt install python{version}-venv')
    with_wheels = [entry for entry in able if entry[1] in PYBULLET_WHEELS]
    python, version, _, headers = (with_wheels or able)[0]
    if version not in PYBULLET_WHEELS:
        _check_compiler(version, headers)
    return python


def _check_compiler(version: tuple[int, int], headers: bool) -> None:
    """Refuse at once what would fail after minutes: pybullet is compiled on 3.12."""
    name = '.'.join(map(str, version))
    if not (shutil.which('g++') or shutil.which('c++')):
        raise SetupError(
            f'pybullet must be compiled for Python {name} and there is no C++ compiler: '
            'apt install g++, or install Python 3.11'
        )
    if not headers:
        raise SetupError(
            f'pybullet must be compiled for Python {name} and its headers are missing: '
            f'apt install python{name}-dev, or install Python 3.11'
        )
    print(f'setup: compiling pybullet for Python {name} takes about 5 minutes', file=sys.stderr)


def run_pip(venv: Path, jazzy: bool) -> None:
    """Install the package, editable, and everything it needs."""
    pip = [str(venv / 'bin' / 'python'), '-m', 'pip', 'install', '--no-input', '--use-pep517']
    pip += ['--disable-pip-version-check', '--progress-bar', 'off']
    (venv / LOG).write_text('')
    if jazzy:
        (venv / 'constraints.txt').write_text('numpy<2\n')  # which Jazzy is compiled for
        _run(venv, [*pip, '--constraint', str(venv / 'constraints.txt'), *BESIDE_JAZZY])
        _run(venv, [*pip, '--no-deps', '--editable', str(ROOT)])
    else:
        pins = ROOT / 'scripts' / 'constraints.txt'
        _run(venv, [*pip, '--constraint', str(pins), '--editable', f'{ROOT}[ros,test]'])


def _run(venv: Path, command: list[str]) -> None:
    """Run pip, tell how far it is, and turn its failure into one line."""
    variables = {**os.environ, 'PYTHONUNBUFFERED': '1'}
    variables.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None)
    progress = Progress()
    with (venv / LOG).open('a') as log:
        pip = subprocess.Popen(
            command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        for line in pip.stdout:
            log.write(line)
            progress.show(line)
        pip.wait()
    progress.end()
    if pip.returncode:
        raise SetupError(f'{meaning((venv / LOG).read_text())} (details in {venv / LOG})')


def meaning(log: str) -> str:
    """Say in words why pip failed."""
    return next((words for sign, words in MEANINGS if sign in log), 'pip failed')


class Progress:
    """One line that tells what pip does: rewritten on a terminal, rare in a log."""

    def __init__(self) -> None:
        self._tty = sys.stderr.isatty()
        self._count = 0
        self._began = time.monotonic()

    def show(self, line: str) -> None:
        """Tell of one line of pip's output, if it means progress."""
        words = line.split()
        if line.startswith('Collecting'):
            self._count += 1
        elif not line.startswith(('Installing collected', 'Building wheels for collected')):
            return
        if self._tty:
            what = f'{words[0].lower()} {words[1]}'[:40]
            seconds = time.monotonic() - self._began
            text = f'\rsetup: {self._count} packages, {seconds:.0f} s, {what:<40}'
            print(text, end='', file=sys.stderr, flush=True)
        elif not line.startswith('Collecting') or self._count % 40 == 0:
            print(f'setup: {self._count} packages, {words[0].lower()}', file=sys.stderr, flush=True)

    def end(self) -> None:
        """Leave the line."""
        if self._tty:
            print(file=sys.stderr)


def lay_out(venv: Path) -> None:
    """Write what `ros2 run` and the ament index look for; pip alone leaves it out."""
    points = configparser.ConfigParser(delimiters=('=',))
    found = venv.glob(f'lib/python3*/site-packages/{PACKAGE}-*.dist-info/entry_points.txt')
    points.read(max(found, key=lambda path: path.stat().st_mtime))
    folder = venv / 'lib' / PACKAGE
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, target in points['console_scripts'].items():
        module, function = target.split(':')
        program = folder / name
        program.write_text(
            f'#!{venv}/bin/python\nimport sys\n\nfrom {module} import {function}\n\n'
            f'sys.exit({function}())\n'
        )
        program.chmod(0o755)
    index = venv / 'share' / 'ament_index' / 'resource_index' / 'packages'
    share = venv / 'share' / PACKAGE
    index.mkdir(parents=True, exist_ok=True)
    share.mkdir(parents=True, exist_ok=True)
    (index / PACKAGE).touch()
    for name in ('package.xml', 'params', 'msg_schemas'):
        if not (share / name).is_symlink():
            (share / name).symlink_to(ROOT / name)
