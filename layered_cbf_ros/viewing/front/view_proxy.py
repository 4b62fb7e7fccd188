"""The way to the 3D scene: its own server listens on this machine alone, behind our door."""

from __future__ import annotations

import asyncio

import aiohttp
from aiohttp import WSMsgType, web

# Of the connection, not of the content; the length and the packing we settle anew.
NOT_PASSED = {'connection', 'keep-alive', 'transfer-encoding', 'content-length', 'upgrade'}
NOT_PASSED |= {'content-encoding', 'set-cookie'}
LARGEST = 50 * 1024 * 1024  # bytes of a message, as the scene's server has it


class ViewProxy:
    """Passes requests and the websocket of the scene on."""

    def __init__(self, port: int) -> None:
        """Prepare.

        Args:
            port: Where the scene is served, on 127.0.0.1.
        """
        self._address = f'127.0.0.1:{port}'

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """Answer one request of the scene's page."""
        path = '/' + request.match_info.get('path', '')
        async with aiohttp.ClientSession(auto_decompress=True) as session:
            try:
                if request.headers.get('Upgrade', '').lower() == 'websocket':
                    return await self._join(request, session, path)
                return await self._fetch(session, path)
            except aiohttp.ClientError:
                raise web.HTTPBadGateway(text='the 3D scene does not answer\n') from None

    async def _fetch(self, session: aiohttp.ClientSession, path: str) -> web.Response:
        async with session.get(f'http://{self._address}{path}') as answer:
            kept = {k: v for k, v in answer.headers.items() if k.lower() not in NOT_PASSED}
            response = web.Response(status=answer.status, body=await answer.read(), headers=kept)
        response.enable_compression()
        return response

    async def _join(
        self, request: web.Request, session: aiohttp.ClientSession, path: str
    ) -> web.WebSocketResponse:
        """Join both websockets until one of them ends."""
        wanted = request.headers.get('Sec-WebSocket-Protocol', '')
        protocols = [name.strip() for name in wanted.split(',') if name.strip()]
        async with session.ws_connect(
            f'ws://{self._address}{path}', protocols=protocols, max_msg_size=LARGEST
        ) as inner:
            agreed = [inner.protocol] if inner.protocol else []
            outer = web.WebSocketResponse(
                protocols=agreed, max_msg_size=LARGEST, compress=False, writer_limit=1024 * 1024
            )
            await outer.prepare(request)
            ways = [asyncio.create_task(pass_on(*way)) for way in ((inner, outer), (outer, inner))]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
                await outer.close()
        return outer


Socket = aiohttp.ClientWebSocketResponse | web.WebSocketResponse


async def pass_on(source: Socket, target: Socket) -> None:
    """Pass messages from one websocket to the other, no faster than it takes them."""
    async for message in source:
        if message.type is WSMsgType.BINARY:
            await target.send_bytes(message.data)
        elif message.type is WSMsgType.TEXT:
            await target.send_str(message.data)
