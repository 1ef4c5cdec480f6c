"""The page as a person sees it: the real bridge on emulated boards, in a headless browser."""

from __future__ import annotations

import base64
import io
import json
import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.ros.process.node_process import NodeProcess

pytestmark = pytest.mark.skipif(
    find_spec('viser') is None, reason="viser is not installed: pip install 'aerarm_ros[view]'"
)
CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
FLAGS = [
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--use-gl=angle',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--window-size=1400,900',
    '--remote-debugging-port=0',
]
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason='chromium is not installed: apt install chromium'
)
PATIENCE = 60.0


class HeadlessBrowser:
    """One page in Chromium, driven over its DevTools protocol."""

    def __init__(self, address: str, profile: Path) -> None:
        from websockets.sync.client import connect  # comes with viser

        assert CHROMIUM
        command = [CHROMIUM, *FLAGS, f'--user-data-dir={profile}', address]
        self._process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._calls = 0
        try:
            self._socket = connect(str(until(lambda: find_page(profile))), max_size=None)
        except BaseException:
            self._process.kill()
            raise

    def call(self, method: str, **parameters: object) -> dict:
        self._calls += 1
        self._socket.send(json.dumps({'id': self._calls, 'method': method, 'params': parameters}))
        while True:
            reply = json.loads(self._socket.recv(timeout=PATIENCE))
            if reply.get('id') == self._calls:
                return reply['result']

    def evaluate(self, script: str) -> object:
        reply = self.call('Runtime.evaluate', expression=script, returnByValue=True)
        return reply['result'].get('value')

    def text(self) -> str:
        return str(self.evaluate('document.body ? document.body.innerText : ""'))

    def press(self, label: str) -> None:
        found = f'[...document.querySelectorAll("button")].find(b => b.innerText == "{label}")'
        until(lambda: self.evaluate(f'Boolean({found})'))
        self.evaluate(f'{found}.click()')

    def picture(self) -> np.ndarray:
        from PIL import Image  # comes with viser

        data = base64.b64decode(self.call('Page.captureScreenshot')['data'])
        return np.asarray(Image.open(io.BytesIO(data)).convert('RGB')).astype(int)

    def close(self) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(10.0)


def find_page(profile: Path) -> str | None:
    """Return the address of the first page's DevTools socket once the browser has one."""
    port_file = profile / 'DevToolsActivePort'
    if not port_file.exists() or '\n' not in port_file.read_text():
        return None
    port = port_file.read_text().split()[0]
    with urllib.request.urlopen(f'http://127.0.0.1:{port}/json') as reply:
        pages = [page for page in json.load(reply) if page['type'] == 'page']
    return pages[0]['webSocketDebuggerUrl'] if pages else None


def until(condition: Callable[[], object], patience: float = PATIENCE) -> object:
    """Wait for a condition and return its value."""
    deadline = time.monotonic() + patience
    while not (value := condition()):
        assert time.monotonic() < deadline, 'waited in vain'
        time.sleep(0.1)
    return value


def orange_pixels(picture: np.ndarray) -> int:
    """Count pixels in the colour of the motors' housings, whatever the light on them."""
    red, green, blue = (picture[:, :, k] for k in range(3))
    middle = np.zeros_like(red, bool)
    middle[:, 450:950] = True
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
        until(lambda: 'the arm is shown at' in log.read_text() or node.returncode is not None)
        assert node.returncode is None, node.tail()
        yield f'http://127.0.0.1:{port}'
        assert node.stop() == 0, node.tail()


@pytest.fixture
def browser(page: str, tmp_path: Path) -> Iterator[HeadlessBrowser]:
    browser = HeadlessBrowser(page, tmp_path / 'profile')
    yield browser
    browser.close()


@needs_browser
def test_shows_the_arm_its_timing_and_stops_it(
    browser: HeadlessBrowser, ros_domain: dict[str, str], tmp_path: Path
) -> None:
    log = tmp_path / 'fake_hardware.log'
    with NodeProcess('fake_hardware', log=log):
        until(lambda: 'idle' in browser.text() and 'joint_states at' in browser.text())
        until(lambda: 'wake lateness' in browser.text())
        for name in ('position [rad]', 'velocity [rad/s]', 'effort [Nm]', 'joint4'):
            assert name in browser.text()
        until(lambda: orange_pixels(browser.picture()) > 100)
        assert 'NOT STOPPED' not in browser.text()
        browser.press('EMERGENCY STOP')
        until(lambda: 'STOPPED' in browser.text())
        assert 'NOT STOPPED' not in browser.text()
        until(lambda: 'emergency stop' in browser.text())
        assert 'e_stop' in log.read_text()


@needs_browser
def test_says_what_is_missing_without_a_bridge(browser: HeadlessBrowser) -> None:
    until(lambda: 'no joint_states in this ROS domain' in browser.text())
    browser.press('EMERGENCY STOP')
    until(lambda: 'NOT STOPPED' in browser.text())
    assert 'is the bridge running' in browser.text()


@needs_browser
def test_the_page_needs_nothing_from_the_internet(browser: HeadlessBrowser, page: str) -> None:
    until(lambda: 'EMERGENCY STOP' in browser.text())
    names = browser.evaluate("performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in names if name.startswith('http') and not name.startswith(page)] == []


def test_serves_on_the_loopback_address_only(page: str, port: int) -> None:
    with urllib.request.urlopen(page) as reply:
        assert reply.status == 200
    lines = Path('/proc/net/tcp').read_text().splitlines()[1:]
    ends = [line.split()[1].split(':') for line in lines if line.split()[3] == '0A']
    assert [host for host, end in ends if int(end, 16) == port] == ['0100007F']


def test_a_wrong_frame_is_one_clear_line(
    ros_domain: dict[str, str], port: int, tmp_path: Path
) -> None:
    log = tmp_path / 'view.log'
    parameters = {'port': port, 'tool': 'gripper'}
    with NodeProcess('view', parameters=parameters, log=log) as node:
        assert node.wait(30.0) == 1
    assert "no frame 'gripper'" in log.read_text()
    assert 'Traceback' not in log.read_text()


def test_an_address_of_another_computer_is_refused(
    ros_domain: dict[str, str], port: int, tmp_path: Path
) -> None:
    log = tmp_path / 'view.log'
    # One that is kept for documentation, so nobody's.
    with NodeProcess('view', parameters={'port': port, 'host': '192.0.2.1'}, log=log) as node:
        assert node.wait(30.0) == 1
    assert 'no page can be served at host 192.0.2.1' in log.read_text()
