"""Somebody who looks at the page: a client that takes what it is sent, and counts pictures."""

import threading
import time

import msgspec  # these three come with viser
import numpy as np
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

_CAMERA = {
    'type': 'ViewerCameraMessage',
    'wxyz': [1.0, 0.0, 0.0, 0.0],
    'position': [0.8, -0.9, 0.7],
    'fov': 1.3,
    'near': 0.01,
    'far': 1000.0,
    'image_height': 900,
    'image_width': 1400,
    'look_at': [0.0, 0.0, 0.3],
    'up_direction': [0.0, 0.0, 1.0],
}
_MOVES = {'SetOrientationMessage', 'SetPositionMessage'}
_WINDOW = 10.0  # [s]


class Onlooker:
    """Looks at a page of this host from now on until it ends.

    Parameters
    ----------
    port
        Of the page.
    """

    def __init__(self, port: int) -> None:
        self._host = f'127.0.0.1:{port}'
        self._pictures: list[float] = []
        threading.Thread(target=self._look, daemon=True).start()

    def rates(self, share: float) -> tuple[float, float]:
        """Return pictures a second: the mean, and the least of any 10 s.

        Parameters
        ----------
        share
            Of the time, at the end, that counts.
        """
        times = np.array(self._pictures)
        if len(times) < 2:
            return 0.0, 0.0
        times = times[times >= times[-1] - share * (times[-1] - times[0])]
        mean = (len(times) - 1) / (times[-1] - times[0])
        starts = np.arange(times[0], times[-1] - _WINDOW, 1.0)
        counts = [np.count_nonzero((times >= t) & (times < t + _WINDOW)) for t in starts]
        return float(mean), min(counts) / _WINDOW if counts else float(mean)

    def _look(self) -> None:
        with connect(
            f'ws://{self._host}',
            origin=f'http://{self._host}',
            subprotocols=[f'viser-v{viser.__version__}'],
            max_size=None,
        ) as page:
            page.send(msgspec.msgpack.encode(_CAMERA))
            try:
                while True:
                    self._take(page.recv())
            except ConnectionClosed:
                return

    def _take(self, raw: bytes) -> None:
        size = int.from_bytes(raw[8:16], 'little')
        messages = msgspec.msgpack.decode(zstandard.decompress(raw[16 : 16 + size]))['messages']
        # What is sent at once is one picture, however many links move.
        if any(message['type'] in _MOVES for message in messages):
            self._pictures.append(time.monotonic())
