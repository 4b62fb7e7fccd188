"""Whether a page can be opened, found out before a run begins."""

from __future__ import annotations

from importlib.util import find_spec

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.viewing.front.door import make_door
from layered_cbf_ros.viewing.front.options import FrontOptions
from layered_cbf_ros.viewing.front.port import listen

NEEDED = ('viser', 'aiohttp')


def check_front(options: FrontOptions) -> None:
    """Make sure that a page can be opened.

    Raises:
        LayeredCbfError: If a package is missing, the port is in use or the token too short.
    """
    for name in NEEDED:
        if find_spec(name) is None:
            needed = ' '.join(NEEDED)
            raise LayeredCbfError(f'the viewer needs the package {name}; pip install {needed}')
    make_door(options.host, options.port, options.token)
    listen(options.host, options.port).close()
