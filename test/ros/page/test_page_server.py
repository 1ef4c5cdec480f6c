"""The page attacked over raw sockets; a browser's part of it is in test/nodes/test_view.py."""

from __future__ import annotations

import http.client
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import pytest
from page_viewer import CAMERA, STOP, Viewer

MISSING = find_spec('viser') is None
pytestmark = pytest.mark.skipif(MISSING, reason="viser is not installed: 'aerarm_ros[view]'")
if not MISSING:
    import viser
    import websockets.asyncio.server as websocket_server
    from websockets.exceptions import ConnectionClosed, InvalidStatus
    from websockets.sync.client import ClientConnection, connect

    from aerarm_ros.ros.page import page_server
    from aerarm_ros.ros.page.page_server import PageError, PageGuard, serve_page
    from aerarm_ros.ros.page.view_panel import ViewPanel


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


def test_the_page_is_served_in_no_frame(page: ServedPage) -> None:
    status, content, headers = page.get()
    assert status == 200
    assert b'<html' in content.lower()
    assert headers['Content-Security-Policy'] == "frame-ancestors 'none'"
    assert headers['X-Frame-Options'] == 'DENY'
    assert headers['Referrer-Policy'] == 'no-referrer'


def test_a_rebound_name_gets_nothing(page: ServedPage) -> None:
    status, content, _ = page.get(Host=f'evil.example:{page.port}')
    assert status == 403
    assert b'<html' not in content.lower()
    own = f'http://evil.example:{page.port}'
    headers = {'Host': f'evil.example:{page.port}'}
    assert refused_status(page, origin=own, additional_headers=headers) in (400, 403)


@pytest.mark.parametrize('origin', ['http://evil.example', 'http://localhost:1', 'null', None])
def test_a_foreign_site_gets_no_websocket(page: ServedPage, origin: str | None) -> None:
    assert refused_status(page, origin=origin) == 403


def test_a_foreign_site_gets_no_page(page: ServedPage) -> None:
    assert page.get(Origin='http://evil.example')[0] == 403
    assert page.refused[0].startswith('rejected: ')


def test_the_button_stops(page: ServedPage) -> None:
    with viewing(page) as viewer:
        before = page.presses
        viewer.send(
            {'type': 'GuiUpdateMessage', 'uuid': viewer.button(STOP), 'updates': {'value': True}}
        )
        viewer.listen(lambda: page.presses == before + 1)


def test_no_client_can_change_the_page_of_others(page: ServedPage) -> None:
    with viewing(page) as viewer, viewing(page) as attacker:
        button = attacker.button(STOP)
        for updates in (
            {'visible': False},
            {'disabled': True},
            {'label': 'start'},
            {'value': True, 'visible': False},
            {'removed': True},
            {'parent_container_id': 'x'},
            {'update_cb': []},
        ):
            attacker.send({'type': 'GuiUpdateMessage', 'uuid': button, 'updates': updates})
        for message in (
            {'type': 'GuiRemoveMessage', 'uuid': button},
            {'type': 'ResetGuiMessage'},
            {'type': 'RunJavascriptMessage', 'source': 'document.body.remove()'},
            {'type': 'ShareUrlRequest'},
            {'type': 'BackgroundImageMessage', 'format': 'png', 'rgb_data': None},
            'nothing',
            {},
        ):
            attacker.send(message)
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
