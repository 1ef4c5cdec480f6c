"""The page as a user sees it: the real bridge on emulated boards, in a headless browser."""

from __future__ import annotations

import json
import re
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from forked_executable import run
from headless_browser import CHROMIUM, HeadlessBrowser, until

from aerarm_ros.ros.process.node_process import NodeProcess

pytestmark = pytest.mark.skipif(
    find_spec('viser') is None, reason="viser is not installed: pip install 'aerarm_ros[view]'"
)


def orange_pixels(picture: np.ndarray) -> int:
    """Count pixels in the colour of the motors' housings, whatever the light on them."""
    red, green, blue = (picture[:, :, k] for k in range(3))
    middle = np.zeros_like(red, bool)
    middle[:, middle.shape[1] // 4 : -middle.shape[1] // 4] = True
    return int((middle & (red > 140) & (red - green > 40) & (green - blue > 25)).sum())


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


@pytest.fixture
def page(ros_domain: dict[str, str], port: int, tmp_path: Path) -> Iterator[str]:
    log = tmp_path / 'view.log'
    with NodeProcess('view', parameters={'port': port}, log=log) as node:
        until(lambda: 'in a browser' in log.read_text() or node.returncode is not None)
        assert node.returncode is None, node.tail()
        yield f'http://127.0.0.1:{port}'
        assert node.stop() == 0, node.tail()


@contextmanager
def foreign_site(html: str) -> Iterator[str]:
    """Serve a page of another site, which differs by its port."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:  # noqa: N802
            self.send_response(200)
            self.send_header('Content-Type', 'text/html')
            self.end_headers()
            self.wfile.write(html.encode())

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(('127.0.0.1', 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f'http://127.0.0.1:{server.server_port}'
    server.shutdown()
    server.server_close()


def get(address: str) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(address) as reply:
            return reply.status, reply.read()
    except urllib.error.HTTPError as refused:
        return refused.code, refused.read()


# What a foreign page tries; what came of it ends up in its title.
ATTACK = """<body><script>
const found = {};
function note(key, value) { found[key] = value; document.title = JSON.stringify(found); }
const socket = new WebSocket('ws://HOST', ['viser-vVERSION']);
socket.onopen = () => note('socket', 'open');
socket.onmessage = () => note('message', 'heard');
socket.onclose = () => note('socket', found.socket || 'refused');
fetch('http://HOST/').then(r => r.text()).then(
  text => note('fetch', text), () => note('fetch', 'refused'));
const frame = document.createElement('iframe');
frame.onload = () => note('frame', 'tried');
frame.src = 'http://HOST/';
frame.width = 1300; frame.height = 800;
document.body.appendChild(frame);
</script></body>"""


@contextmanager
def browser_at(address: str, tmp_path: Path) -> Iterator[HeadlessBrowser]:
    browser = HeadlessBrowser(address, tmp_path / 'profile')
    try:
        yield browser
    finally:
        browser.close()


def test_on_the_network_only_the_address_with_the_token_shows_and_stops_the_arm(
    ros_domain: dict[str, str], port: int, tmp_path: Path
) -> None:
    with open_to_the_network(port, tmp_path) as (node, address):
        token = address.rstrip('/').rsplit('/', 1)[1]
        assert len(token) >= 32
        for path in ('/', f'/{token[:-1]}/', f'/?{token}'):
            status, content = get(f'http://127.0.0.1:{port}{path}')
            assert status == 403
            assert b'<html' not in content.lower()
        assert get(address)[0] == 200
        assert node.log is not None
        assert node.log.read_text().count(token) == 1
        for path in Path('/proc').glob('[0-9]*/cmdline'):
            with suppress(OSError):  # it has ended meanwhile
                assert token.encode() not in path.read_bytes()
        if CHROMIUM is None:
            pytest.skip('chromium is not installed: apt install chromium')
        with browser_at(address, tmp_path) as browser:
            assert_works_without_a_bridge_and_the_internet(browser, f'http://127.0.0.1:{port}/')
            assert_shows_and_stops_the_arm(browser, tmp_path / 'fake_hardware.log')


def assert_shows_and_stops_the_arm(browser: HeadlessBrowser, log: Path) -> None:
    with NodeProcess('fake_hardware', (), {'encoders': 'absolute'}, log=log):
        until(lambda: 'idle' in browser.text() and 'joint_states at' in browser.text())
        until(lambda: str(browser.evaluate('document.title')).startswith('idle'))
        browser.unfold('Timing')
        until(lambda: 'wake lateness' in browser.text())
        for name in ('position [rad]', 'velocity [rad/s]', 'effort [Nm]', 'joint4'):
            assert name in browser.text()
        until(lambda: orange_pixels(browser.picture()) > 100)
        assert_fits_a_phone(browser)
        browser.press('EMERGENCY STOP')
        until(lambda: re.search('(?<!NOT )STOPPED', browser.text()))
        assert 'NOT STOPPED' not in browser.text()
        until(lambda: 'emergency stop' in browser.text())
        assert 'e_stop' in log.read_text()


def assert_fits_a_phone(browser: HeadlessBrowser) -> None:
    """Check that stop and mode are at the top, over the whole width, with the arm below."""
    browser.call(
        'Emulation.setDeviceMetricsOverride',
        width=390,
        height=844,
        deviceScaleFactor=1,
        mobile=True,
    )

    def places() -> dict[str, list[float]]:
        script = """(() => {
          const box = e => { const r = e.getBoundingClientRect();
                             return [r.left, r.top, r.right, r.bottom]; };
          const stop = [...document.querySelectorAll('button')].find(
            b => b.innerText == 'EMERGENCY STOP');
          return {stop: box(stop), mode: box(document.querySelector('.arm-mode')),
                  arm: box(document.querySelector('canvas'))};
        })()"""
        return browser.evaluate(script)  # type: ignore[return-value]

    until(lambda: places()['stop'][2] > 370.0 and places()['arm'][1] > 400.0)
    found = places()
    assert found['stop'][0] < 20.0
    assert found['stop'][3] < 120.0
    assert found['stop'][3] <= found['mode'][1] < 150.0
    assert found['arm'][3] <= 845.0
    browser.call('Emulation.clearDeviceMetricsOverride')


def test_another_site_in_the_same_browser_and_other_hosts_reach_nothing(
    page: str, port: int, tmp_path: Path
) -> None:
    assert get(page)[0] == 200
    lines = Path('/proc/net/tcp').read_text().splitlines()[1:]
    ends = [line.split()[1].split(':') for line in lines if line.split()[3] == '0A']
    assert [host for host, end in ends if int(end, 16) == port] == ['0100007F']
    if CHROMIUM is None:
        pytest.skip('chromium is not installed: apt install chromium')
    import viser

    html = ATTACK.replace('HOST', page.removeprefix('http://'))
    with (
        foreign_site(html.replace('VERSION', viser.__version__)) as site,
        browser_at(site, tmp_path) as browser,
    ):
        done = {'socket', 'fetch', 'frame'}
        until(lambda: done <= set(json.loads(str(browser.evaluate('document.title')) or '{}')))
        found = json.loads(str(browser.evaluate('document.title')))
        assert found['socket'] == 'refused'
        assert found['fetch'] == 'refused'
        assert 'message' not in found
        tree = browser.call('Page.getFrameTree')['frameTree']
        (child,) = tree['childFrames']
        assert 'unreachableUrl' in child['frame']


def assert_works_without_a_bridge_and_the_internet(browser: HeadlessBrowser, site: str) -> None:
    until(lambda: 'no joint_states in this ROS domain' in browser.text())
    browser.press('EMERGENCY STOP')
    until(lambda: 'NOT STOPPED' in browser.text())
    assert 'no bridge offers the service e_stop: check that a bridge runs in' in browser.text()
    names = browser.evaluate("performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in names if name.startswith('http') and not name.startswith(site)] == []


@contextmanager
def open_to_the_network(port: int, tmp_path: Path) -> Iterator[tuple[NodeProcess, str]]:
    """Serve at all interfaces; the second value is the address that was printed."""
    log = tmp_path / 'view.log'
    with NodeProcess('view', parameters={'port': port, 'host': '0.0.0.0'}, log=log) as node:
        line = until(lambda: re.search(r'open (http://\S+) in a browser', log.read_text()))
        assert isinstance(line, re.Match)
        path = urlsplit(line[1]).path
        yield node, f'http://127.0.0.1:{port}{path}'


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ({'tool': 'gripper'}, "frame 'gripper' is not in the URDF"),
        # An address that is kept for documentation, so nobody's.
        ({'host': '192.0.2.1'}, 'the page cannot be served at the address 192.0.2.1'),
    ],
)
def test_a_wrong_frame_or_address_is_one_clear_line(
    ros_domain: dict[str, str],
    port: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    given: dict[str, object],
    reason: str,
) -> None:
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    done = run('view', parameters={'port': port, **given})
    assert done.returncode == 1
    assert not list(tmp_path.glob('aerarm_*'))
    said = done.stderr + done.stdout
    assert reason in said
    assert 'Traceback' not in said
