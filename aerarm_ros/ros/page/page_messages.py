"""What a browser that shows the page may say to it."""

from __future__ import annotations

import msgspec

Vector = tuple[float, float, float]


class CameraMoved(
    msgspec.Struct, tag_field='type', tag='ViewerCameraMessage', forbid_unknown_fields=True
):
    """Where somebody looks at the arm from; it is of no consequence for others."""

    wxyz: tuple[float, float, float, float]
    position: Vector
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: Vector
    up_direction: Vector


class Press(msgspec.Struct, forbid_unknown_fields=True):
    """What a click changes of a button."""

    value: bool


class ButtonPressed(
    msgspec.Struct, tag_field='type', tag='GuiUpdateMessage', forbid_unknown_fields=True
):
    """A click. The same message could hide, rename or disable any element for everybody."""

    uuid: str
    updates: Press


_DECODER = msgspec.msgpack.Decoder(CameraMoved | ButtonPressed)


def is_allowed(message: object) -> bool:
    """Tell whether a message of a websocket is one that the page itself sends."""
    if not isinstance(message, bytes):
        return False
    try:
        _DECODER.decode(message)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False
    return True
