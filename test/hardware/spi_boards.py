"""Emulated boards that the real py-spidev reaches through a preloaded shim."""

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
FLAGS = ('-shared', '-fPIC', '-O2', '-Wall', '-Werror')


def missing() -> str:
    """Return why these tests cannot run on this host, or an empty text."""
    if not sys.platform.startswith('linux'):
        return 'preloading needs Linux'
    if compiler() is None:
        return 'no C compiler (cc) to build test/hardware/spi_shim.c'
    if importlib.util.find_spec('spidev') is None:
        return 'the module spidev is not installed (extra spi)'
    return ''


def compiler() -> str | None:
    return shutil.which('cc') or shutil.which('gcc')


class SpiBoards:
    """Context with a running server; `environment` is for the processes that use the bus.

    With `paced`, the boards' time follows the frames and their encoders are absolute, see
    `spi_server`. The bridge then needs a configuration with absolute encoders.
    """

    def __init__(self, paced: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='spi')
        folder = Path(self._folder.name)
        shim = folder / 'spi_shim.so'
        subprocess.run([compiler(), *FLAGS, '-o', shim, HERE / 'spi_shim.c', '-ldl'], check=True)
        socket = str(folder / 'bus')
        self.environment = {'LD_PRELOAD': str(shim), 'SPI_SHIM_SOCKET': socket}
        self._process = subprocess.Popen(
            [sys.executable, HERE / 'spi_server.py', socket, *(['PACED'] if paced else [])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._read()  # the server is running

    def set(self, device: str, **attributes: object) -> None:
        """Change attributes of a `spi_server.Device`."""
        self._ask({'set': {'device': device, **attributes}})

    def vanish(self, device: str) -> None:
        """Remove a device."""
        self._ask({'vanish': device})

    def come_back(self, device: str) -> None:
        """Replace a removed device by another one of that name."""
        self._ask({'come back': device})

    def inject(self, fault: str) -> None:
        """Inject a fault into a board."""
        self._ask({'inject': fault})

    def let_pass(self, seconds: float) -> None:
        """Advance the time of paced boards without frames."""
        self._ask({'pass': seconds})

    def report(self) -> list[dict]:
        """Return the received data and the state of each board."""
        return self._ask({})

    def _ask(self, command: dict) -> list[dict]:
        self._process.stdin.write(json.dumps(command) + '\n')
        self._process.stdin.flush()
        return self._read()

    def _read(self) -> list[dict]:
        return json.loads(self._process.stdout.readline())

    def __enter__(self) -> 'SpiBoards':
        return self

    def __exit__(self, *_: object) -> None:
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait(120.0)  # slow on a busy machine
        self._folder.cleanup()
