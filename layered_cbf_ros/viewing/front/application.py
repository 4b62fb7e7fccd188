"""The routes of the front, and the guard before each of them."""

from __future__ import annotations

from pathlib import Path

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from layered_cbf_ros.viewing.front.door import Door
from layered_cbf_ros.viewing.front.operator_socket import OperatorSocket
from layered_cbf_ros.viewing.front.view_proxy import ViewProxy

PAGE = Path(__file__).parent / 'page'
# The scene's page brings its scripts inline; ours takes nothing but our own files.
STRICT = "default-src 'self'; style-src 'self'; img-src 'self' data:; frame-ancestors 'self'"
FRAMED_BY_US = "frame-ancestors 'self'"
NO_TOKEN = '401: this page needs its token; open the address that the viewer printed\n'


def make_application(door: Door, view: ViewProxy, operator: OperatorSocket) -> web.Application:
    """Return the web application.

    Args:
        door: Who may enter.
        view: The way to the 3D scene.
        operator: The websocket of our pages.
    """
    guard = Guard(door)
    application = web.Application(middlewares=[guard.admit], client_max_size=1024)
    application.on_response_prepare.append(guard.dress)
    application.add_routes(
        [
            web.get('/', _page),
            web.get('/operator', operator.handle),
            web.post('/e_stop', operator.stop),
            web.get('/view', view.handle),
            web.get('/view/{path:.*}', view.handle),
            web.static('/page', PAGE),
        ]
    )
    return application


async def _page(request: web.Request) -> web.FileResponse:
    return web.FileResponse(PAGE / 'index.html')


class Guard:
    """Stands before every route: is it for us, is the token known, who sent the page that acts."""

    def __init__(self, door: Door) -> None:
        self._door = door

    @property
    def admit(self) -> Middleware:
        """Return the middleware that lets a request in, or refuses it in words."""

        @web.middleware
        async def admitted(request: web.Request, handler: Handler) -> web.StreamResponse:
            if not self._door.is_for_us(request.host):
                raise web.HTTPForbidden(text=f"403: '{request.host}' is not this machine\n")
            if not self._door.admits(request.cookies, request.query):
                raise web.HTTPUnauthorized(text=NO_TOKEN)
            acts = request.method != 'GET' or 'Upgrade' in request.headers
            origin = request.headers.get('Origin', '')
            if acts and not self._door.is_same_site(origin, request.host):
                raise web.HTTPForbidden(text='403: only a page of this viewer may do that\n')
            try:
                response = await handler(request)
            except ConnectionError:  # the visitor is gone before he was answered
                return web.Response(status=400)
            by_address = self._door.knows(request.query.get('token', ''))
            if self._door.token and by_address and not response.prepared:
                cookie = self._door.cookie, self._door.token
                response.set_cookie(*cookie, httponly=True, samesite='Strict')
            return response

        return admitted

    async def dress(self, request: web.Request, response: web.StreamResponse) -> None:
        """Give a response the headers that keep other sites out."""
        ours = not request.path.startswith('/view')
        response.headers['Content-Security-Policy'] = STRICT if ours else FRAMED_BY_US
        response.headers['X-Content-Type-Options'] = 'nosniff'
        response.headers['Referrer-Policy'] = 'no-referrer'
        response.headers['Cache-Control'] = 'no-cache'
