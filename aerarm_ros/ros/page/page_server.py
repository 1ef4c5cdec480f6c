"""The web server of the page, with a guard in front of it."""

from __future__ import annotations

import http
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import viser
import websockets.asyncio.server as websocket_server
from websockets import Headers
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from aerarm_ros.ros.page.page_dress import dress
from aerarm_ros.ros.page.page_guard import PageGuard
from aerarm_ros.ros.page.page_messages import is_allowed

MESSAGE_MAX = 4096  # [bytes] the page's own are a tenth of it
_REPORT_PERIOD = 10.0  # [s]
_HEADERS = {
    # In a frame of another site the button could be clicked unseen.
    'Content-Security-Policy': "frame-ancestors 'none'",
    'X-Frame-Options': 'DENY',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'X-Content-Type-Options': 'nosniff',
    'Cache-Control': 'no-store',
    # The token is in the address.
    'Referrer-Policy': 'no-referrer',
}

Report = Callable[[str], None]


class PageError(RuntimeError):
    """The page cannot be guarded; the message says what to do."""


def serve_page(host: str, port: int, guard: PageGuard, report: Report) -> viser.ViserServer:
    """Serve a page of which every request and every message is judged.

    Parameters
    ----------
    host, port
        Where; the next free port is taken.
    guard
        Judges requests.
    report
        Called with what was refused, at most every ten seconds, from the server's thread.

    Raises
    ------
    PageError
        If this viser serves in a way that cannot be guarded.
    """
    gate = _Gate(guard, report)
    with _guarded(gate):
        server = viser.ViserServer(host, port, verbose=False)
    if not gate.closed:
        server.stop()
        raise PageError(
            f'the page of viser {viser.__version__} cannot be guarded against other sites: '
            "pip install 'viser>=1.1,<1.2'"
        )
    return server


class _Gate:
    """Applies the guard to requests, and the list of messages to connections.

    Attributes
    ----------
    closed
        Whether the server was made with it.
    """

    def __init__(self, guard: PageGuard, report: Report) -> None:
        self.closed = False
        self._guard = guard
        self._report = report
        self._silent_until = 0.0

    def options(self, options: dict[str, Any]) -> dict[str, Any]:
        """Return options of a websocket server with the gate in them."""
        inner = options.get('process_request')
        if inner is None:
            return options
        self.closed = True
        gate = self

        class PageConnection(ServerConnection):
            """A connection that hears the page's own messages only."""

            async def recv(self, decode: bool | None = None) -> Any:
                while not is_allowed(message := await super().recv(decode)):
                    gate.refused('a message that the page does not send')
                return message

        def process(connection: ServerConnection, request: Request) -> Response | None:
            return self._process(connection, request, inner)

        return {
            **options,
            'process_request': process,
            'create_connection': PageConnection,
            'max_size': MESSAGE_MAX,
            'server_header': None,
        }

    def refused(self, what: str) -> None:
        """Say what was refused, unless something was just now."""
        now = time.monotonic()
        if now >= self._silent_until:
            self._silent_until = now + _REPORT_PERIOD
            self._report(f'refused: {what}')

    def _process(
        self,
        connection: ServerConnection,
        request: Request,
        inner: Callable[[ServerConnection, Request], Response | None],
    ) -> Response | None:
        headers = request.headers
        refusal = self._guard.refusal(
            request.path,
            headers.get_all('Host'),
            headers.get_all('Origin'),
            'Upgrade' in headers,
        )
        if refusal:
            self.refused(refusal)
            return connection.respond(http.HTTPStatus.FORBIDDEN, f'{refusal}\n')
        request.path = self._guard.inner_path(request.path)
        response = inner(connection, request)
        if response is not None:
            dress(response)
            response.headers.update(Headers(_HEADERS))
        return response


@contextmanager
def _guarded(gate: _Gate) -> Iterator[None]:
    """Let whatever websocket server is made meanwhile have the gate.

    viser makes its server itself and takes no options for it.
    """
    serve = websocket_server.serve

    def serve_guarded(*arguments: Any, **options: Any) -> Any:
        return serve(*arguments, **gate.options(options))

    websocket_server.serve = serve_guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websocket_server.serve = serve  # type: ignore[misc]
