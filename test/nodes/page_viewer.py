"""A client of the page's protocol without a browser, which stores the received state."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or find_spec('viser') is not None:
    import msgspec
    import zstandard
    from websockets.sync.client import ClientConnection

STOP = 'EMERGENCY STOP'
CAMERA = {
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


class Viewer:
    """One connection to the page."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.told: list[dict[str, Any]] = []
        self._shown: dict[str, dict[str, Any]] = {}
        self._read = 0  # messages processed so far

    def send(self, message: object) -> None:
        self._socket.send(msgspec.msgpack.encode(message))

    def listen(self, condition: Callable[[], object], patience: float = 20.0) -> None:
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, 'waited in vain'
            try:
                raw = self._socket.recv(timeout=0.05)
            except TimeoutError:
                continue
            size = int.from_bytes(raw[8:16], 'little')
            content = msgspec.msgpack.decode(zstandard.decompress(raw[16 : 16 + size]))
            self.told += content['messages']

    def elements(self) -> dict[str, dict[str, Any]]:
        """Return the received properties of the panel's elements."""
        shown = self._shown
        for message in self.told[self._read :]:
            kind = message['type']
            if kind.startswith('Gui') and 'props' in message:
                shown[message['uuid']] = {'kind': kind, **message['props']}
            elif kind == 'GuiUpdateMessage' and message['uuid'] in shown:
                shown[message['uuid']] |= message['updates']
            elif kind == 'GuiRemoveMessage':
                shown.pop(message['uuid'], None)
            elif kind == 'ResetGuiMessage':
                shown.clear()
        self._read = len(self.told)
        return shown

    def button(self, label: str) -> str:
        """Return an element's name in messages, '' if it is not shown correctly."""
        for uuid, element in self.elements().items():
            is_named = 'disabled' in element and str(element.get('label')).startswith(label)
            if is_named and element['visible']:
                return '' if element['disabled'] else uuid
        return ''

    def set(self, label: str, value: object) -> None:
        """Change an element like a user, once it is shown."""
        self.listen(lambda: self.button(label))
        uuid = self.button(label)
        self.send({'type': 'GuiUpdateMessage', 'uuid': uuid, 'updates': {'value': value}})

    def text(self) -> str:
        """Return the text of the page."""
        return ' '.join(str(element.get('content', '')) for element in self.elements().values())
