"""Client of the view page that receives all messages and counts frames."""

import sys
import threading
import time
from pathlib import Path

import msgspec  # viser installs these three
import numpy as np
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

sys.path.append(str(Path(__file__).parents[3] / 'test' / 'nodes'))
from page_viewer import CAMERA

_MOVES = {'SetOrientationMessage', 'SetPositionMessage'}
_WINDOW = 10.0  # [s]


class Onlooker:
    """Client that views a page of this host until it ends.

    Parameters
    ----------
    port
        Port of the page.
    """

    def __init__(self, port: int) -> None:
        self._host = f'127.0.0.1:{port}'
        self._pictures: list[float] = []
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    @property
    def is_there(self) -> bool:
        """Whether the client is still connected; the page disconnects a client silent for 20 s."""
        return self._thread.is_alive()

    def rates(self, begun: float) -> tuple[float, float]:
        """Return frames per second since the monotonic time `begun` [s]: the mean, the worst 10 s.

        Only changes count as frames, so an arm at rest gives none.
        """
        now = time.monotonic()
        times = np.array(self._pictures)
        starts = np.arange(begun, now - _WINDOW, 1.0)
        counts = [np.count_nonzero((times >= t) & (times < t + _WINDOW)) for t in starts]
        mean = np.count_nonzero(times >= begun) / (now - begun)
        return float(mean), min(counts, default=mean * _WINDOW) / _WINDOW

    def _look(self) -> None:
        with connect(
            f'ws://{self._host}',
            origin=f'http://{self._host}',
            subprotocols=[f'viser-v{viser.__version__}'],
            max_size=None,
        ) as page:
            page.send(msgspec.msgpack.encode(CAMERA))
            try:
                while True:
                    self._take(page.recv())
            except ConnectionClosed:
                return

    def _take(self, raw: bytes) -> None:
        size = int.from_bytes(raw[8:16], 'little')
        messages = msgspec.msgpack.decode(zstandard.decompress(raw[16 : 16 + size]))['messages']
        # Messages sent together form one frame, however many links move.
        if any(message['type'] in _MOVES for message in messages):
            self._pictures.append(time.monotonic())
