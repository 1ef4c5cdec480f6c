"""A page in headless Chromium, driven over its DevTools protocol."""

import base64
import io
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path

import numpy as np

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
    '--window-size=800,520',
    '--remote-debugging-port=0',
]
PATIENCE = 60.0


class HeadlessBrowser:
    """One page in Chromium, driven over its DevTools protocol."""

    def __init__(self, address: str, profile: Path) -> None:
        from websockets.sync.client import connect  # a dependency of viser

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
        from PIL import Image  # a dependency of viser

        data = base64.b64decode(self.call('Page.captureScreenshot')['data'])
        return np.asarray(Image.open(io.BytesIO(data)).convert('RGB')).astype(int)

    def close(self) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(60.0)


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
