"""Where the package's data files are: installed by colcon or pip, or in the source tree."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from layered_cbf_ros.errors import LayeredCbfError

PACKAGE = 'layered_cbf_ros'


def find_folder(name: str) -> Path:
    """Return a data folder of the package.

    The package may lie in an overlay of a ROS workspace (AMENT_PREFIX_PATH), in a
    virtual environment (sys.prefix) or in its source tree; the first one counts.

    Args:
        name: 'params' or 'msg_schemas'.

    Raises:
        LayeredCbfError: If it is nowhere.
    """
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    folders = [Path(prefix) / 'share' / PACKAGE / name for prefix in (*prefixes, sys.prefix)]
    folders.append(Path(__file__).resolve().parents[1] / name)
    for folder in folders:
        if folder.is_dir():
            return folder
    looked = ', '.join(str(folder) for folder in folders)
    raise LayeredCbfError(f"no folder '{name}' in {looked}; install the package again")
