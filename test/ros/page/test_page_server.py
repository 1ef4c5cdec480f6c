"""The page attacked over raw sockets; a browser's part of it is in test/nodes/test_view.py."""

from __future__ import annotations

import gzip
import http.client
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from page_viewer import CAMERA, STOP, Viewer

MISSING = find_spec('viser') is None
pytestmark = pytest.mark.skipif(MISSING, reason="viser is not installed: 'aerarm_ros[view]'")
if not MISSING:
    import msgspec
    import viser
    import websockets.asyncio.server as websocket_server
    from websockets import Headers
    from websockets.exceptions import ConnectionClosed, InvalidStatus
    from websockets.http11 import Response
    from websockets.sync.client import ClientConnection, connect

    from aerarm_ros.ros.page import page_server
    from aerarm_ros.ros.page.page_server import (
        PageError,
        PageGuard,
        dress,
        is_allowed,
        is_loopback,
        serve_page,
    )
    from aerarm_ros.ros.page.view_panel import ViewPanel


# Messages of browsers, which a client may forge

PRESS: dict[str, Any] = {'type': 'GuiUpdateMessage', 'uuid': 'a', 'updates': {'value': True}}
CHANGES = (
    {'visible': False},
    {'value': True, 'visible': False},
    {'disabled': True},
    {'label': 'start'},
    {'removed': True},
    {'parent_container_id': 'x'},
    {'update_cb': []},
    {'value': 'x' * 1000},
    {'value': None},
    {'value': {'label': 'start'}},
    None,
)
FORGED: tuple[Any, ...] = (
    *(PRESS | {'updates': changes} for changes in CHANGES),
    {'type': 'GuiRemoveMessage', 'uuid': 'a'},
    {'type': 'ResetGuiMessage'},
    {'type': 'RunJavascriptMessage', 'source': 'document.body.remove()'},
    {'type': 'ShareUrlRequest'},
    {'type': 'BackgroundImageMessage', 'format': 'png', 'rgb_data': None},
    {'type': 'SceneNodeUpdateMessage', 'name': '/arm', 'updates': {'visible': False}},
    {'type': ['GuiUpdateMessage']},
    CAMERA | {'excluded_self_client': 1},
    CAMERA | {'wxyz': [1.0] * 5},
    CAMERA | {'position': [[1.0], 0.0, 0.0]},
    CAMERA | {'image_height': 10**12 * 0.5},
    {key: value for key, value in CAMERA.items() if key != 'fov'},
    {},
    7,
    'nothing',
    [PRESS, PRESS],
)


def test_only_messages_of_the_page_are_accepted() -> None:
    values = (True, 0.35, -1, 'computed_torque')
    for message in (CAMERA, *(PRESS | {'updates': {'value': value}} for value in values)):
        assert is_allowed(msgspec.msgpack.encode(message)), message
    for message in FORGED:
        assert not is_allowed(msgspec.msgpack.encode(message)), message
    for raw in (b'', b'\xc1', b'\x81', b'\x91' * 100_000 + b'\x90', 'text', None):
        assert not is_allowed(raw)


class ServedPage:
    """The real page; pressing its button only counts."""

    def __init__(self, host: str = '127.0.0.1', token: str = '') -> None:
        self.presses = 0
        self.refused: list[str] = []
        self.server = serve_page(host, 18080, PageGuard(host, token), self.refused.append)
        self.panel = ViewPanel(self.server, 'arm', self._press)
        self.port = self.server.get_port()
        self.host = f'127.0.0.1:{self.port}'

    def _press(self, action: str) -> tuple[bool, str]:
        self.presses += action == 'e_stop'
        return True, 'stopped'

    def get(self, path: str = '/', **headers: str) -> tuple[int, bytes, dict[str, str]]:
        connection = http.client.HTTPConnection('127.0.0.1', self.port, timeout=10.0)
        connection.putrequest('GET', path, skip_host=True)
        for name, value in ({'Host': self.host} | headers).items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return answer.status, content, dict(answer.getheaders())

    def connect(self, path: str = '', origin: str | None = '', **options: Any) -> ClientConnection:
        origin = f'http://{self.host}' if origin == '' else origin
        address = f'ws://{self.host}{path}'
        return connect(
            address,
            origin=origin,
            subprotocols=[f'viser-v{viser.__version__}'],
            compression=None,
            max_size=None,
            **options,
        )  # type: ignore[arg-type]


@contextmanager
def served(host: str = '127.0.0.1', token: str = '') -> Iterator[ServedPage]:
    page = ServedPage(host, token)
    yield page
    page.server.stop()


@pytest.fixture(scope='module')
def page() -> Iterator[ServedPage]:
    with served() as page:
        yield page


@contextmanager
def viewing(page: ServedPage, **options: Any) -> Iterator[Viewer]:
    """A client that has told where it looks from, as the page does."""
    with page.connect(**options) as socket:
        viewer = Viewer(socket)
        viewer.send(CAMERA)
        viewer.listen(lambda: viewer.button(STOP))
        yield viewer


def refused_status(page: ServedPage, **options: Any) -> int:
    with pytest.raises(InvalidStatus) as refused, page.connect(**options):
        pass
    return refused.value.response.status_code


def test_the_page_is_served_in_no_frame_and_foreign_sites_get_nothing(page: ServedPage) -> None:
    status, content, headers = page.get()
    assert (status, b'<html' in content.lower()) == (200, True)
    assert headers['Content-Security-Policy'] == "frame-ancestors 'none'"
    assert (headers['X-Frame-Options'], headers['Referrer-Policy']) == ('DENY', 'no-referrer')
    lines = [line.split() for line in Path('/proc/net/tcp').read_text().splitlines()[1:]]
    ends = [line[1].split(':') for line in lines if line[3] == '0A']
    assert [host for host, end in ends if int(end, 16) == page.port] == ['0100007F']
    evil = f'evil.example:{page.port}'
    for headers in ({'Host': evil}, {'Origin': 'http://evil.example'}):
        status, content, _ = page.get(**headers)
        assert (status, b'<html' in content.lower()) == (403, False)
    assert page.refused[0].startswith('rejected: ')
    for origin in ('http://evil.example', 'http://localhost:1', 'null', None):
        assert refused_status(page, origin=origin) == 403
    headers = {'Host': evil}
    assert refused_status(page, origin=f'http://{evil}', additional_headers=headers) in (400, 403)


def test_no_client_can_change_the_page_of_others(page: ServedPage) -> None:
    with viewing(page) as viewer, viewing(page) as attacker:
        button = attacker.button(STOP)
        for message in FORGED:
            named = 'uuid' in message if isinstance(message, dict) else False
            attacker.send({**message, 'uuid': button} if named else message)
        before = page.presses
        # Messages of a client stay in order: once this one acts, the others have been judged.
        attacker.send({'type': 'GuiUpdateMessage', 'uuid': button, 'updates': {'value': True}})
        attacker.listen(lambda: page.presses == before + 1)
        told = len(viewer.told)
        viewer.listen(lambda: any('STOPPED' in str(x.get('updates')) for x in viewer.told[told:]))
        assert viewer.button(STOP) == button
        assert not {'GuiRemoveMessage', 'RunJavascriptMessage', 'ShareUrlUpdated'} & {
            message['type'] for message in viewer.told
        }
        with viewing(page) as newcomer:
            assert newcomer.button(STOP) == button


def test_a_too_long_message_ends_only_its_connection(page: ServedPage) -> None:
    with viewing(page) as viewer:
        with page.connect() as attacker:
            attacker.send(b'\x00' * 1_000_000)
            with pytest.raises(ConnectionClosed):
                while True:
                    attacker.recv(timeout=10.0)
        before = page.presses
        viewer.send(
            {'type': 'GuiUpdateMessage', 'uuid': viewer.button(STOP), 'updates': {'value': True}}
        )
        viewer.listen(lambda: page.presses == before + 1)


def test_on_a_network_nothing_is_served_without_the_token() -> None:
    with served('0.0.0.0', 'right-token') as page:
        for path in ('/', '/wrong-token/', '/right-toke/', '/?right-token', '/index.html'):
            status, content, _ = page.get(path)
            assert status == 403, path
            assert b'<html' not in content.lower()
            assert b'right-token' not in content
        assert page.get('/right-token/')[0] == 200
        assert page.get('/right-token')[0] == 200
        for path in ('', '/', '/wrong-token'):
            assert refused_status(page, path=path) == 403
        assert refused_status(page, path='/right-token', origin='http://evil.example') == 403
        with viewing(page, path='/right-token'):
            pass
        assert 'right-token' not in ''.join(page.refused)


def test_a_server_that_cannot_be_guarded_serves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    serve = websocket_server.serve
    # As if viser had got its server elsewhere.
    monkeypatch.setattr(page_server._Gate, 'options', lambda self, options: options)
    with pytest.raises(PageError, match='cannot protect the page'):
        serve_page('127.0.0.1', 18080, PageGuard('127.0.0.1'), print)
    assert websocket_server.serve is serve


# Headers, path and token


def local() -> PageGuard:
    return PageGuard('127.0.0.1')


def refusal(
    guard: PageGuard, host: str | None, origin: str | None = None, path: str = '/', ws: bool = False
) -> str:
    return guard.refusal(path, [host] if host else [], [origin] if origin else [], ws)


OWN = '127.0.0.1:8080'
NOT_HERE, OTHER_SITE = 'not a name of this computer', 'other web site'


@pytest.mark.parametrize('host', [OWN, 'localhost:9000', '[::1]:8080', 'LOCALHOST'])
def test_requests_of_the_page_itself_are_accepted(host: str) -> None:
    assert refusal(local(), host) == ''
    assert refusal(local(), host, f'http://{host}', ws=True) == ''


@pytest.mark.parametrize(
    ('host', 'origin', 'said'),
    [
        ('evil.example:8080', None, NOT_HERE),
        ('127.0.0.1.evil.example', None, NOT_HERE),
        ('127.0.0.1@evil.example', None, NOT_HERE),
        ('evil.example@127.0.0.1:8080', None, NOT_HERE),
        ('127.0.0.1:8080/evil', None, NOT_HERE),
        ('127.0.0.1:port', None, NOT_HERE),
        ('[::1', None, NOT_HERE),
        (' ', None, NOT_HERE),
        (None, None, NOT_HERE),
        (OWN, 'http://evil.example', OTHER_SITE),
        (OWN, 'http://127.0.0.1:9999', OTHER_SITE),
        (OWN, 'https://127.0.0.1:8080', OTHER_SITE),
        (OWN, 'http://127.0.0.1:8080.evil.example', OTHER_SITE),
        (OWN, 'null', OTHER_SITE),
    ],
)
@pytest.mark.parametrize('ws', [False, True])
def test_other_names_and_sites_are_rejected(
    host: str | None, origin: str | None, said: str, ws: bool
) -> None:
    assert said in refusal(local(), host, origin, ws=ws)


def test_a_websocket_needs_an_origin_and_no_header_may_come_twice() -> None:
    assert 'an empty value' in refusal(local(), OWN, ws=True)
    assert local().refusal('/', [OWN, 'evil.example'], [], False)
    assert local().refusal('/', [OWN], [f'http://{OWN}', 'http://evil.example'], True)


def test_on_a_network_the_token_is_required() -> None:
    guard = PageGuard('0.0.0.0', 'secret')
    host = '192.168.1.2:8080'
    for path in ('/', '/secre/', '/secret1/', '/SECRET/', '/?secret', '//secret/', '/x/secret/'):
        assert 'token' in refusal(guard, host, path=path), path
        assert 'token' in refusal(guard, host, f'http://{host}', path, ws=True)
    for path in ('/secret', '/secret/', '/secret/?darkMode', '/secret?x'):
        assert refusal(guard, host, path=path) == ''
    assert guard.inner_path('/secret') == '/'
    assert guard.inner_path('/secret/a/b?c=/d') == '/a/b?c=/d'


@pytest.mark.parametrize(
    'host', ['192.168.1.2', '[fe80::1]:8080', socket.gethostname(), 'localhost']
)
def test_a_page_for_all_goes_by_every_name_of_this_computer(host: str) -> None:
    assert refusal(PageGuard('0.0.0.0'), host) == ''
    assert refusal(PageGuard('0.0.0.0'), 'evil.example')


def test_tokens_are_new_each_time_and_only_where_they_are_needed() -> None:
    addresses = {PageGuard.for_host('0.0.0.0').address('pi', 80) for _ in range(5)}
    assert len(addresses) == 5
    assert min(map(len, addresses)) >= len('http://pi:80//') + 32
    assert PageGuard.for_host('::1').address('::1', 80) == 'http://[::1]:80'


@pytest.mark.parametrize(
    ('host', 'loopback'),
    [('127.0.0.1', True), ('127.1.2.3', True), ('localhost', True), ('::1', True)]
    + [('0.0.0.0', False), ('::', False), ('', False), ('192.168.1.2', False), ('pi', False)],
)
def test_loopback_addresses_are_recognized(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


PAGE = b'<html><head><title>Viser</title></head><body></body></html>'


@pytest.mark.parametrize('encoding', ['identity', 'gzip'])
def test_title_and_layout_are_added_to_a_page_with_the_right_length(encoding: str) -> None:
    body = gzip.compress(PAGE) if encoding == 'gzip' else PAGE
    headers = {'Content-Type': 'text/html; charset=utf-8', 'Content-Encoding': encoding}
    response = Response(200, 'OK', Headers(**headers, **{'Content-Length': str(len(body))}), body)
    dress(response)
    assert response.headers.get_all('Content-Length') == [str(len(response.body))]
    plain = gzip.decompress(response.body) if encoding == 'gzip' else bytes(response.body)
    assert b'<title>aerarm</title>' in plain
    assert b'document.title' in plain
    assert plain.count(b'</head>') == 1
