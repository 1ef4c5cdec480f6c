"""What a browser that shows the page may say to it."""

from __future__ import annotations

from typing import Annotated

import msgspec

Vector = tuple[float, float, float]
Text = Annotated[str, msgspec.Meta(max_length=200)]


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


class Change(msgspec.Struct, forbid_unknown_fields=True):
    """What a click changes of a button, a slider, a box to tick, a list or a text."""

    value: bool | float | Text


class ElementChanged(
    msgspec.Struct, tag_field='type', tag='GuiUpdateMessage', forbid_unknown_fields=True
):
    """A click. The same message could hide, rename or disable any element for everybody."""

    uuid: str
    updates: Change


class TargetMoved(
    msgspec.Struct,
    tag_field='type',
    tag='TransformControlsUpdateMessage',
    forbid_unknown_fields=True,
):
    """The tool's target, dragged."""

    name: Text
    wxyz: tuple[float, float, float, float]
    position: Vector
    owner: Text


class TargetTaken(
    msgspec.Struct,
    tag_field='type',
    tag='TransformControlsDragStartMessage',
    forbid_unknown_fields=True,
):
    """The tool's target is held from now on."""

    name: Text
    owner: Text


class TargetLeft(
    msgspec.Struct,
    tag_field='type',
    tag='TransformControlsDragEndMessage',
    forbid_unknown_fields=True,
):
    """The tool's target is held no more."""

    name: Text
    owner: Text


_DECODER = msgspec.msgpack.Decoder(
    CameraMoved | ElementChanged | TargetMoved | TargetTaken | TargetLeft
)


def is_allowed(message: object) -> bool:
    """Tell whether a message of a websocket is one that the page itself sends."""
    if not isinstance(message, bytes):
        return False
    try:
        _DECODER.decode(message)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False
    return True
