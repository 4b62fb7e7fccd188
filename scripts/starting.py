"""Start programs in the Python environment of this project, made first if it must be.

Standard library only, and it runs on old Pythons too; see environment.py.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from environment import (
    PACKAGE,
    SetupError,
    fingerprint,
    is_ready,
    jazzy_is_complete,
    missing_beside_jazzy,
    run_variables,
    venv_folder,
)


def prepare() -> tuple[Path, dict[str, str]]:
    """Return the environment, made first if it must be, and its variables.

    Exits with one line on standard error if it can't be made.
    """
    variables = dict(os.environ)
    venv = venv_folder(variables)
    wanted = fingerprint(variables)
    if not is_ready(venv, wanted):
        missing = missing_beside_jazzy(variables)
        if variables.get('ROS_DISTRO') == 'jazzy' and missing:
            names = ', '.join(missing)
            print(f'setup: Jazzy is sourced without {names}; wheels are used', file=sys.stderr)
        import installation  # a ready environment starts without it

        try:
            installation.install(venv, wanted, jazzy_is_complete(variables))
        except SetupError as error:
            sys.exit(f'setup: {error}')
        except KeyboardInterrupt:
            sys.exit('\nsetup: interrupted; the next start does it again')
    return venv, run_variables(variables, venv)


def executables(venv: Path) -> list[str]:
    """Return the names of the programs of this package."""
    folder = venv / 'lib' / PACKAGE
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def start(venv: Path, variables: dict[str, str], name: str, arguments: list[str]) -> None:
    """Become one of the programs; does not return."""
    program = venv / 'lib' / PACKAGE / name
    sys.stdout.flush()
    os.execve(str(program), [str(program), *arguments], variables)
