"""The web server of the page, with a guard in front of it."""

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
    """Return what the head of the page gets: style and script."""
    style, script = (_FOLDER.joinpath(name).read_bytes() for name in ('view.css', 'view.js'))
    return b'<style>\n%b</style><script>\n%b</script></head>' % (style, script)


def dress(response: Response) -> None:
    """Add title and layout to a page that is served, in place; leave anything else alone."""
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
    """Judges requests before anything is answered.

    A browser lets every site open connections to every address, the loopback one included, and
    tells in `Origin` which site it is: only the page itself may. A site whose name its owner has
    led to this computer (DNS rebinding) is its own origin, but its name is in `Host`: only
    names of this computer may be there. On a network a token, the first part of the path, is
    asked for as well.

    Parameters
    ----------
    host
        Name or address at which the page is served, or that of all interfaces.
    token
        What the path begins with; none is asked for if empty.
    """

    def __init__(self, host: str, token: str = '') -> None:
        self._names = {name.lower() for name in (*_LOOPBACK, *_own_names(host))}
        self._any_address = host in _WILDCARDS
        self._token = token.encode()

    @classmethod
    def for_host(cls, host: str) -> PageGuard:
        """Return a guard with a new token, unless only this computer can reach the page."""
        return cls(host, '' if is_loopback(host) else secrets.token_urlsafe(24))

    def refusal(
        self, path: str, hosts: Sequence[str], origins: Sequence[str], socket_wanted: bool
    ) -> str:
        """Return why a request is refused, '' if it may be answered.

        Parameters
        ----------
        path
            Its path, with query.
        hosts, origins
            All its headers of these names.
        socket_wanted
            Whether it asks for a websocket; browsers then tell the origin, always.
        """
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return f'{_shown(hosts)} is not a name of this computer: use the printed URL'
        if len(origins) > 1 or (socket_wanted and not origins):
            return f'the request comes from {_shown(origins)}, not from this page'
        if origins and origins[0].lower() != f'http://{hosts[0]}'.lower():
            return f'the request comes from another site, {_shown(origins)}'
        given, _ = _split(path)
        if self._token and not hmac.compare_digest(given.encode(errors='replace'), self._token):
            return 'the address lacks the token: use the URL printed at the start'
        return ''

    def inner_path(self, path: str) -> str:
        """Return a path without its token."""
        return _split(path)[1] if self._token else path

    def address(self, host: str, port: int) -> str:
        """Return what to open in a browser."""
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
        # Whoever asks for a number is led astray by no name.
        return self._any_address and _is_number(name)


def is_loopback(host: str) -> bool:
    """Tell whether only this computer reaches what is served there."""
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
    """Return the first part of a path and, from its slash on, the rest."""
    plain, question, query = path.partition('?')
    first, _, rest = plain.removeprefix('/').partition('/')
    return first, f'/{rest}{question}{query}'


def _shown(headers: Sequence[str]) -> str:
    """Return headers for people, short and without control characters."""
    return repr(', '.join(headers)[:80]) if headers else 'an empty value'


Vector = tuple[float, float, float]
Text = Annotated[str, msgspec.Meta(max_length=200)]


class CameraMoved(
    msgspec.Struct, tag_field='type', tag='ViewerCameraMessage', forbid_unknown_fields=True
):
    """Camera pose of one browser."""

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
    """What a click changes of a button, a slider, a box to tick, a list or a text."""

    value: bool | float | Text


class ElementChanged(
    msgspec.Struct, tag_field='type', tag='GuiUpdateMessage', forbid_unknown_fields=True
):
    """A click. The same message could hide, rename or disable any element for everybody."""

    uuid: str
    updates: Change


class TargetMoved(
    msgspec.Struct,
    tag_field='type',
    tag='TransformControlsUpdateMessage',
    forbid_unknown_fields=True,
):
    """The tool's target, dragged."""

    name: Text
    wxyz: tuple[float, float, float, float]
    position: Vector
    owner: Text


class TargetTaken(
    msgspec.Struct,
    tag_field='type',
    tag='TransformControlsDragStartMessage',
    forbid_unknown_fields=True,
):
    """The tool's target is held from now on."""

    name: Text
    owner: Text


class TargetLeft(
    msgspec.Struct,
    tag_field='type',
    tag='TransformControlsDragEndMessage',
    forbid_unknown_fields=True,
):
    """The tool's target is held no more."""

    name: Text
    owner: Text


_DECODER = msgspec.msgpack.Decoder(
    CameraMoved | ElementChanged | TargetMoved | TargetTaken | TargetLeft
)


def is_allowed(message: object) -> bool:
    """Tell whether a message of a websocket is one that the page itself sends."""
    if not isinstance(message, bytes):
        return False
    try:
        _DECODER.decode(message)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False
    return True


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
            f'viser {viser.__version__} offers no way to protect the page against other sites: '
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
            """A connection that accepts only the page's own messages."""

            async def recv(self, decode: bool | None = None) -> Any:
                while not is_allowed(message := await super().recv(decode)):
                    gate.refused('the page does not send messages of this type')
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
            self._report(f'rejected: {what}')

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
