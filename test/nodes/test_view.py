"""The page as a user sees it: the real bridge on emulated boards, in a headless browser."""

from __future__ import annotations

import re
import socket
import urllib.error
import urllib.request
from contextlib import suppress
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


def test_on_the_network_only_the_address_with_the_token_shows_and_stops_the_arm(
    ros_domain: dict[str, str], port: int, tmp_path: Path
) -> None:
    log, site = tmp_path / 'view.log', f'http://127.0.0.1:{port}'
    with NodeProcess('view', parameters={'port': port, 'host': '0.0.0.0'}, log=log):
        line = until(lambda: re.search(r'open (http://\S+) in a browser', log.read_text()))
        assert isinstance(line, re.Match)
        path = urlsplit(line[1]).path
        token = path.strip('/')
        assert len(token) >= 32
        with pytest.raises(urllib.error.HTTPError, match='403'):
            urllib.request.urlopen(f'{site}/')
        with urllib.request.urlopen(f'{site}{path}') as reply:
            assert reply.status == 200
        assert log.read_text().count(token) == 1
        for command in Path('/proc').glob('[0-9]*/cmdline'):
            with suppress(OSError):  # it has ended meanwhile
                assert token.encode() not in command.read_bytes()
        if CHROMIUM is None:
            pytest.skip('chromium is not installed: apt install chromium')
        browser = HeadlessBrowser(f'{site}{path}', tmp_path / 'profile')
        try:
            assert_works_without_a_bridge_and_the_internet(browser, f'{site}/')
            assert_shows_and_stops_the_arm(browser, tmp_path / 'fake_hardware.log')
        finally:
            browser.close()


def assert_works_without_a_bridge_and_the_internet(browser: HeadlessBrowser, site: str) -> None:
    until(lambda: 'no joint_states in this ROS domain' in browser.text())
    browser.press('EMERGENCY STOP')
    until(lambda: 'NOT STOPPED' in browser.text())
    assert 'no bridge offers the service e_stop: check that a bridge runs in' in browser.text()
    names = browser.evaluate("performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in names if name.startswith('http') and not name.startswith(site)] == []


def assert_shows_and_stops_the_arm(browser: HeadlessBrowser, log: Path) -> None:
    with NodeProcess('fake_hardware', (), {'encoders': 'absolute'}, log=log):
        until(lambda: 'idle' in browser.text() and 'joint_states at' in browser.text())
        until(lambda: str(browser.evaluate('document.title')).startswith('idle'))
        for name in ('position [rad]', 'velocity [rad/s]', 'effort [Nm]', 'joint4'):
            assert name in browser.text()
        until(lambda: orange_pixels(browser.picture()) > 100)
        browser.press('EMERGENCY STOP')
        until(lambda: re.search('(?<!NOT )STOPPED', browser.text()))
        assert 'NOT STOPPED' not in browser.text()
        until(lambda: 'emergency stop' in browser.text())
        assert 'e_stop' in log.read_text()


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
