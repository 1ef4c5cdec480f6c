"""Web server of the page; it rejects requests and messages from other web sites."""

from __future__ import annotations

import gzip
import hmac
import http
import secrets
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

import msgspec
import viser
import websockets.asyncio.server as websocket_server
from websockets import Headers
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

_FOLDER = Path(__file__).parent


@cache
def _additions() -> bytes:
    """Return the CSS and JavaScript that the server adds to the HTML head of viser's page."""
    style, script = (_FOLDER.joinpath(name).read_bytes() for name in ('view.css', 'view.js'))
    return b'<style>\n%b</style><script>\n%b</script></head>' % (style, script)


def dress(response: Response) -> None:
    """If a response is an HTML page, add the title, the CSS and the JavaScript to the response."""
    if not response.headers.get('Content-Type', '').startswith('text/html'):
        return
    packed = response.headers.get('Content-Encoding') == 'gzip'
    response.body = _dressed(bytes(response.body), packed)
    del response.headers['Content-Length']
    response.headers['Content-Length'] = str(len(response.body))


@lru_cache(maxsize=4)
def _dressed(page: bytes, packed: bool) -> bytes:
    plain = gzip.decompress(page) if packed else page
    plain = plain.replace(b'<title>Viser</title>', b'<title>aerarm</title>', 1)
    plain = plain.replace(b'</head>', _additions(), 1)
    return gzip.compress(plain) if packed else plain


_WILDCARDS = ('', '0.0.0.0', '::')
_LOOPBACK = ('localhost', '127.0.0.1', '::1')


class PageGuard:
    """Reject requests from other web sites: check the headers, and the secret token in the path.

    A browser permits every site to connect to every address, even to the loopback address, and
    sends the site's name in `Origin`. So `Origin` must name the page itself. A site that uses DNS
    rebinding passes this check, but the browser sends the site's name in `Host`. So `Host` must
    name this computer. On a network, the path must also begin with a token.

    Parameters
    ----------
    host
        Host name or address of the page, or the address of all interfaces.
    token
        Required first part of the path; empty for none.
    """

    def __init__(self, host: str, token: str = '') -> None:
        self._names = {name.lower() for name in (*_LOOPBACK, *_own_names(host))}
        self._any_address = host in _WILDCARDS
        self._token = token.encode()

    @classmethod
    def for_host(cls, host: str) -> PageGuard:
        """Return a guard with a new secret token; for a loopback address, without a token."""
        return cls(host, '' if is_loopback(host) else secrets.token_urlsafe(24))

    def refusal(
        self, path: str, hosts: Sequence[str], origins: Sequence[str], socket_wanted: bool
    ) -> str:
        """Return the reason to reject a request, or an empty string if it is permitted.

        Parameters
        ----------
        path
            Path of the request, with query.
        hosts, origins
            All `Host` and `Origin` headers of the request.
        socket_wanted
            Whether the request opens a websocket; browsers then always send the origin.
        """
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return (
                f'the header Host is {_shown(hosts)}, which is not a name of this computer: use '
                'the URL that view prints'
            )
        if len(origins) > 1 or (socket_wanted and not origins):
            return f'the header Origin is {_shown(origins)}: use the URL that view prints'
        if origins and origins[0].lower() != f'http://{hosts[0]}'.lower():
            return (
                f'the other web site {_shown(origins)} sent the request: use the URL that view '
                'prints'
            )
        given, _ = _split(path)
        if self._token and not hmac.compare_digest(given.encode(errors='replace'), self._token):
            return 'the requested URL lacks the secret token: use the URL that view prints'
        return ''

    def inner_path(self, path: str) -> str:
        """Return the path of a request without the token."""
        return _split(path)[1] if self._token else path

    @property
    def is_private(self) -> bool:
        """Whether the page needs no token, because other computers cannot reach it."""
        return not self._token

    def address(self, host: str, port: int) -> str:
        """Return the page's URL with the secret token, for the user's browser."""
        name = socket.gethostname() if host in _WILDCARDS else host
        shown = f'[{name}]' if ':' in name else name
        return f'http://{shown}:{port}' + (f'/{self._token.decode()}/' if self._token else '')

    def _is_own(self, host: str) -> bool:
        try:
            parts = urlsplit(f'//{host}')
            name, _ = parts.hostname, parts.port
        except ValueError:
            return False
        if name is None or parts.username is not None or parts.path or parts.query:
            return False
        if name in self._names:
            return True
        # A request for a numeric address cannot result from DNS rebinding.
        return self._any_address and _is_number(name)


def is_loopback(host: str) -> bool:
    """Return whether `host` is a loopback address, which other computers cannot reach."""
    return host.lower() == 'localhost' or (_is_number(host) and ip_address(host).is_loopback)


def _own_names(host: str) -> Iterable[str]:
    if host not in _WILDCARDS:
        return [host]
    name = socket.gethostname()
    return [name, f'{name}.local', socket.getfqdn()]


def _is_number(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _split(path: str) -> tuple[str, str]:
    """Split a URL path after its first component; the returned rest begins with a slash."""
    plain, question, query = path.partition('?')
    first, _, rest = plain.removeprefix('/').partition('/')
    return first, f'/{rest}{question}{query}'


def _shown(headers: Sequence[str]) -> str:
    """Return the values of an HTTP header as a short text with escaped control characters."""
    return repr(', '.join(headers)[:80]) if headers else 'an empty value'


Vector = tuple[float, float, float]
Text = Annotated[str, msgspec.Meta(max_length=200)]


class PageMessage(msgspec.Struct, tag_field='type', forbid_unknown_fields=True):
    """Message from a browser to the web server of the page."""


class CameraMoved(PageMessage, tag='ViewerCameraMessage'):
    """Message from a browser that the user moved the camera of the 3D view."""

    wxyz: tuple[float, float, float, float]
    position: Vector
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: Vector
    up_direction: Vector


class Change(msgspec.Struct, forbid_unknown_fields=True):
    """Only property of a page element that a browser may change: the value of the element."""

    value: bool | float | Text


class ElementChanged(PageMessage, tag='GuiUpdateMessage'):
    """Message from a browser that the user changed the value of a page element.

    A forged message with other properties could hide, rename or disable elements for all users.
    """

    uuid: str
    updates: Change


_DECODER = msgspec.msgpack.Decoder(CameraMoved | ElementChanged)


def is_allowed(message: object) -> bool:
    """Return whether a websocket message is of a type that the page itself sends."""
    if not isinstance(message, bytes):
        return False
    try:
        _DECODER.decode(message)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False
    return True


MESSAGE_MAX = 4096  # [bytes]; messages of the page have a tenth of this size
_REPORT_PERIOD = 10.0  # [s]
_HEADERS = {
    # Another site could hide the button in a frame and provoke a click.
    'Content-Security-Policy': "frame-ancestors 'none'",
    'X-Frame-Options': 'DENY',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'X-Content-Type-Options': 'nosniff',
    'Cache-Control': 'no-store',
    # The address contains the token.
    'Referrer-Policy': 'no-referrer',
}

Report = Callable[[str], None]


class PageError(RuntimeError):
    """Error if the installed version of the package viser cannot protect the page."""


def serve_page(host: str, port: int, guard: PageGuard, report: Report) -> viser.ViserServer:
    """Start the web server of the page, which checks every request and websocket message.

    Parameters
    ----------
    host, port
        Address of the server. If the port is in use, the server uses the next free port.
    guard
        Guard that checks the requests.
    report
        Function that the server's thread calls with a text about a rejected request, at most once
        in ten seconds.

    Raises
    ------
    PageError
        If the installed viser cannot protect the page; the message states the version to install.
    """
    gate = _Gate(guard, report)
    with _guarded(gate):
        server = viser.ViserServer(host, port, verbose=False)
    if not gate.is_used:
        server.stop()
        raise PageError(
            f'viser {viser.__version__} cannot protect the page against other web sites: run pip '
            "install 'viser>=1.1,<1.2'"
        )
    return server


class _Gate:
    """Check all requests to a web server with a `PageGuard`, and ignore forged messages.

    Attributes
    ----------
    is_used
        Whether a websocket server was created with this gate.
    """

    def __init__(self, guard: PageGuard, report: Report) -> None:
        self.is_used = False
        self._guard = guard
        self._report = report
        self._silent_until = 0.0

    def options(self, options: dict[str, Any]) -> dict[str, Any]:
        """Add the checks of this class to the options of a websocket server; return all options."""
        inner = options.get('process_request')
        if inner is None:
            return options
        self.is_used = True
        gate = self

        class PageConnection(ServerConnection):
            """Websocket connection that ignores messages of types that the page does not send."""

            async def recv(self, decode: bool | None = None) -> Any:
                while not is_allowed(message := await super().recv(decode)):
                    gate.refused('a websocket message of a type that the page does not send')
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
        """Report a rejected request or message, at most once in ten seconds."""
        now = time.monotonic()
        if now >= self._silent_until:
            self._silent_until = now + _REPORT_PERIOD
            self._report(f'rejected: {what}')

    def _process(
        self,
        connection: ServerConnection,
        request: Request,
        inner: Callable[[ServerConnection, Request], Response | None],
    ) -> Response | None:
        headers = request.headers
        refusal = self._guard.refusal(
            request.path, headers.get_all('Host'), headers.get_all('Origin'), 'Upgrade' in headers
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
    """Let each websocket server that starts inside a `with` block apply the checks of `gate`.

    viser creates its server internally without these checks, so this function replaces the function
    `serve` of the package websockets.
    """
    serve = websocket_server.serve

    def serve_guarded(*arguments: Any, **options: Any) -> Any:
        return serve(*arguments, **gate.options(options))

    websocket_server.serve = serve_guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websocket_server.serve = serve  # type: ignore[misc]
