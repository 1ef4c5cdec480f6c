from importlib.util import find_spec
from typing import Any

import pytest

MISSING = find_spec('viser') is None
pytestmark = pytest.mark.skipif(MISSING, reason="viser is not installed: 'aerarm_ros[view]'")
if not MISSING:
    import msgspec

    from aerarm_ros.ros.page.page_server import is_allowed

CAMERA: dict[str, Any] = {
    'type': 'ViewerCameraMessage',
    'wxyz': [1, 0.0, 0.0, 0.0],
    'position': [0.8, -0.9, 0.7],
    'fov': 1.3,
    'near': 0.01,
    'far': 1000,
    'image_height': 900,
    'image_width': 1400,
    'look_at': [0.0, 0.0, 0.3],
    'up_direction': [0, 0, 1],
}
PRESS: dict[str, Any] = {'type': 'GuiUpdateMessage', 'uuid': 'a', 'updates': {'value': True}}
TARGET: dict[str, Any] = {
    'type': 'TransformControlsUpdateMessage',
    'name': '/arm/tool_target',
    'wxyz': [1.0, 0.0, 0.0, 0.0],
    'position': [0.3, 0, 0.5],
    'owner': '',
}


def allowed(message: object) -> bool:
    return is_allowed(msgspec.msgpack.encode(message))


def test_messages_of_the_page_are_accepted() -> None:
    assert allowed(CAMERA)
    assert allowed(PRESS)
    for value in (0.35, -1, 'computed_torque', False):
        assert allowed(PRESS | {'updates': {'value': value}})
    assert allowed(TARGET)
    for kind in ('TransformControlsDragStartMessage', 'TransformControlsDragEndMessage'):
        assert allowed({'type': kind, 'name': '/arm/tool_target', 'owner': ''})


@pytest.mark.parametrize(
    'updates',
    [
        {'visible': False},
        {'value': True, 'visible': False},
        {'disabled': True},
        {'label': 'start'},
        {'removed': True},
        {'value': 'x' * 1000},
        {'value': None},
        {'value': [1.0, 2.0]},
        {'value': {'label': 'start'}},
        {},
        [],
        None,
    ],
)
def test_a_press_with_other_changes_is_rejected(updates: object) -> None:
    assert not allowed(PRESS | {'updates': updates})


@pytest.mark.parametrize(
    'message',
    [
        {'type': 'GuiRemoveMessage', 'uuid': 'a'},
        {'type': 'ResetGuiMessage'},
        {'type': 'ShareUrlRequest'},
        {'type': 'RunJavascriptMessage', 'source': 'alert(1)'},
        {'type': 'FileTransferStartUpload', 'source_component_uuid': 'a'},
        {'type': 'SceneNodeUpdateMessage', 'name': '/arm', 'updates': {'visible': False}},
        {'type': ['GuiUpdateMessage']},
        CAMERA | {'excluded_self_client': 1},
        CAMERA | {'wxyz': [1.0] * 5},
        CAMERA | {'position': [[1.0], 0.0, 0.0]},
        CAMERA | {'image_height': 10**12 * 0.5},
        TARGET | {'visible': False},
        TARGET | {'position': [0.3, 0.0]},
        {key: value for key, value in CAMERA.items() if key != 'fov'},
        {},
        [],
        7,
        None,
        [PRESS, PRESS],
    ],
)
def test_other_messages_are_rejected(message: object) -> None:
    assert not allowed(message)


@pytest.mark.parametrize('raw', [b'', b'\xc1', b'\x81', b'\x91' * 100_000 + b'\x90', 'text', None])
def test_invalid_messages_are_rejected(raw: object) -> None:
    assert not is_allowed(raw)
