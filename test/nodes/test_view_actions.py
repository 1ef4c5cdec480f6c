"""A short session at the page: enable, move, stop, clear, over its own socket."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest
from page_viewer import CAMERA, STOP, Viewer

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.ros.process.node_process import NodeProcess

MISSING = find_spec('viser') is None
pytestmark = pytest.mark.skipif(MISSING, reason="viser is not installed: 'aerarm_ros[view]'")
if not MISSING:
    import viser
    from websockets.sync.client import connect


PATIENCE = 120.0
EXAMPLES = Path(__file__).parents[2] / 'config' / 'examples'


def mode(viewer: Viewer) -> str:
    """Return what the page's title says."""
    return viewer.text().partition('data-title="')[2].partition(' ')[0]


@contextmanager
def shown(folder: Path, parameters: dict[str, object]) -> Iterator[Viewer]:
    """Serve the page, look at it, and end it."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    log = folder / 'view.log'
    with NodeProcess('view', (), {'port': port, **parameters}, log=log) as view:
        while 'in a browser' not in log.read_text():
            assert view.returncode is None, view.tail()
            time.sleep(0.1)
        host = f'127.0.0.1:{port}'
        with connect(
            f'ws://{host}',
            origin=f'http://{host}',  # type: ignore[arg-type]
            subprotocols=[f'viser-v{viser.__version__}'],  # type: ignore[list-item]
            compression=None,
            max_size=None,
        ) as connection:
            viewer = Viewer(connection)
            viewer.send(CAMERA)
            yield viewer
        assert view.stop() == 0, view.tail()  # its recorder ends before it does


def test_the_arm_is_enabled_moved_stopped_and_brought_back(
    ros_domain: dict[str, str], tmp_path: Path
) -> None:
    arm = {'pace': 'keep_up', 'encoders': 'absolute'}
    with (
        NodeProcess('fake_hardware', (), arm, log=tmp_path / 'arm.log'),
        shown(tmp_path, {}) as viewer,
    ):
        drive(viewer)


def test_sliders_go_as_far_as_the_bridge_lets_a_joint_that_turns_for_ever(
    ros_domain: dict[str, str], tmp_path: Path
) -> None:
    config = EXAMPLES / 'three_joints.yaml'
    turn = load_arm_config(config).joints[0]

    def sliders(viewer: Viewer) -> dict[str, tuple[float, float]]:
        elements = viewer.elements().values()
        return {str(e['label']): (e['min'], e['max']) for e in elements if 'min' in e}

    with shown(tmp_path, {'config': config, 'urdf': EXAMPLES / 'three_joints.urdf'}) as viewer:
        viewer.listen(lambda: turn.name in sliders(viewer), PATIENCE)
        assert sliders(viewer)[turn.name] == (turn.position_min, turn.position_max)


def drive(viewer: Viewer) -> None:
    """Press the page's buttons in order."""

    def wait(condition: str) -> None:
        viewer.listen(lambda: mode(viewer) == condition, PATIENCE)

    wait('idle')
    viewer.set('Enable', True)
    wait('ready')
    viewer.set('controller', 'computed_torque')
    viewer.set('Start controller', True)
    wait('running')
    viewer.listen(lambda: viewer.button('Stop controller'), PATIENCE)
    viewer.set('joint2', 1.2)
    end = time.monotonic() + PATIENCE
    while 'the motion takes' not in viewer.text():
        assert time.monotonic() < end, viewer.text()
        viewer.set('Move to slider values', True)
        heard = len(viewer.told)
        viewer.listen(lambda heard=heard: len(viewer.told) > heard + 20, PATIENCE)
    viewer.set(STOP, True)
    wait('fault')
    # The arm stops at once; that it did is told when no other bridge is to be found.
    viewer.listen(lambda: '>STOPPED</b>' in viewer.text(), PATIENCE)
    viewer.listen(lambda: 'To recover' in viewer.text(), PATIENCE)  # diagnostics come each second
    while mode(viewer) not in ('ready', 'running'):  # its controller goes on
        if viewer.button('Next step'):
            viewer.set('Next step', True)
        elif viewer.button('Enable'):
            viewer.set('Enable', True)
        told = len(viewer.told)
        viewer.listen(lambda told=told: len(viewer.told) > told + 50, PATIENCE)
