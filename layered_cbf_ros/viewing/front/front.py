"""The front: the web server of the page, in a thread of its own beside the drawing."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from aiohttp import web

from layered_cbf_ros.viewing.front.application import make_application
from layered_cbf_ros.viewing.front.door import make_door
from layered_cbf_ros.viewing.front.operator_socket import OperatorSocket
from layered_cbf_ros.viewing.front.options import FrontOptions
from layered_cbf_ros.viewing.front.port import listen, own_address
from layered_cbf_ros.viewing.front.team import Team
from layered_cbf_ros.viewing.front.view_proxy import ViewProxy
from layered_cbf_ros.viewing.sight.snapshot import Snapshot

CLOSING_S = 5.0


class Front:
    """Serves the page from its making until it is closed.

    Attributes:
        address: What a person opens, with the token if there is one.
    """

    def __init__(
        self,
        options: FrontOptions,
        view_port: int,
        sight: Callable[[], Snapshot | None],
        team: Team | None,
    ) -> None:
        """Open the page.

        Args:
            options: Address, port and token.
            view_port: Where the 3D scene is served, on 127.0.0.1.
            sight: Returns the newest sight of the run; called from the front's thread.
            team: Passes the operator's wishes on, called from the front's thread; None if
                there is nobody to steer, as in a bag: then the page shows the scene alone.

        Raises:
            ParameterError: If the port is in use, the address not ours, the token too short.
        """
        self._socket = listen(options.host, options.port)
        port = self._socket.getsockname()[1]
        door = make_door(options.host, port, options.token)
        self._operator = OperatorSocket(team, sight)
        self._application = make_application(door, ViewProxy(view_port), self._operator)
        host = own_address(options.host)
        self.address = f'http://{host}:{port}/' + (f'?token={door.token}' if door.token else '')
        self._loop = asyncio.new_event_loop()
        self._closing = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name='front', daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Tell whether it serves; one that broke has to be ended, and is no use any more."""
        return self._thread.is_alive()

    @property
    def is_watched(self) -> bool:
        """Tell whether any page is open."""
        return self._operator.pages > 0

    def close(self) -> None:
        """Close the page; whoever steers is let go."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._closing.set)
            self._thread.join(CLOSING_S)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()
            self._socket.close()

    async def _serve(self) -> None:
        """Serve until told to close, or until the watch over the operator breaks."""
        runner = web.AppRunner(self._application, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        await web.SockSite(runner, self._socket).start()
        watching = asyncio.create_task(self._operator.watch())
        closing = asyncio.create_task(self._closing.wait())
        try:
            await asyncio.wait((watching, closing), return_when=asyncio.FIRST_COMPLETED)
            if watching.done():
                watching.result()
        finally:
            for task in (watching, closing):
                task.cancel()
            self._operator.close()
            await runner.cleanup()
