"""Where the Python environment of this project is, whether it is ready, and what it sets.

Standard library only, and it runs on old Pythons too, so that a person is told
what is wrong instead of being shown a syntax error. Nothing here needs a network
once the environment exists.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = 'layered_cbf_ros'
STAMP = 'layered_cbf_ros.stamp'
NATIVE = ('rclpy', 'pinocchio', 'proxsuite')


class SetupError(Exception):
    """The environment can't be made; the text tells a person what to do."""


def jazzy_is_complete(variables: dict[str, str]) -> bool:
    """Tell whether a ROS 2 Jazzy installation is sourced that has all we need of it.

    Its compiled modules are made for one another (and for numpy 1), so they are used
    all together, as `rosdep install` brings them, or not at all.
    """
    return variables.get('ROS_DISTRO') == 'jazzy' and not missing_beside_jazzy(variables)


def missing_beside_jazzy(variables: dict[str, str]) -> list[str]:
    """Return which of the modules that we need the sourced workspaces do not have."""
    folders = [Path(p) for p in variables.get('PYTHONPATH', '').split(os.pathsep) if p]
    return [name for name in NATIVE if not any((folder / name).is_dir() for folder in folders)]


def venv_folder(variables: dict[str, str]) -> Path:
    """Return where the environment is, or is to be made."""
    chosen = variables.get('LAYERED_CBF_ROS_VENV')
    if chosen:
        return Path(chosen).resolve()
    return ROOT / ('.venv-jazzy' if jazzy_is_complete(variables) else '.venv')


def fingerprint(variables: dict[str, str]) -> str:
    """Return a hash of everything an environment is made from."""
    digest = hashlib.sha256(f'{ROOT} {jazzy_is_complete(variables)}'.encode())
    for name in ('setup.py', 'setup.cfg', 'scripts/constraints.txt', 'scripts/installation.py'):
        digest.update((ROOT / name).read_bytes())
    return digest.hexdigest()


def is_ready(venv: Path, wanted: str) -> bool:
    """Tell whether the environment is complete and made from the present files."""
    try:
        return (venv / STAMP).read_text() == wanted
    except OSError:
        return False


def run_variables(variables: dict[str, str], venv: Path) -> dict[str, str]:
    """Return the environment variables that the project's programs run with."""
    run = dict(variables)
    run['PATH'] = os.pathsep.join([str(venv / 'bin'), run.get('PATH', os.defpath)])
    run['VIRTUAL_ENV'] = str(venv)
    run.pop('PYTHONHOME', None)
    if jazzy_is_complete(variables):
        run['AMENT_PREFIX_PATH'] = os.pathsep.join([str(venv), run.get('AMENT_PREFIX_PATH', '')])
        run.setdefault('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp')
    else:
        _leave_other_ros(run)
        run['AMENT_PREFIX_PATH'] = str(venv)
        run['RMW_IMPLEMENTATION'] = 'rmw_fastrtps_cpp'
    run.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    run.setdefault('ROS_LOG_DIR', str(ROOT / 'log'))
    run.setdefault('OMP_NUM_THREADS', '1')
    run.setdefault('MPLBACKEND', 'Agg')
    return run


def _leave_other_ros(run: dict[str, str]) -> None:
    """Take out what would mix another ROS, or another environment, into the wheels'.

    The wheels restart each interpreter once with LD_LIBRARY_PATH set. A guard
    variable left by the interpreter of another environment would suppress that.
    """
    run.pop('PYTHONPATH', None)
    if run.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None):
        run.pop('LD_LIBRARY_PATH', None)
    prefixes = tuple(p for p in run.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p)
    libraries = run.pop('LD_LIBRARY_PATH', '').split(os.pathsep)
    kept = [path for path in libraries if path and not path.startswith(prefixes)]
    if kept:
        run['LD_LIBRARY_PATH'] = os.pathsep.join(kept)
