"""Reaction of the launch files to the end of their processes."""

import signal
from pathlib import Path
from typing import Any

import pytest
from launched import MISSING

pytestmark = pytest.mark.skipif(bool(MISSING), reason=MISSING)


@pytest.mark.parametrize(
    ('status', 'is_ending', 'fails'),
    [
        (0, False, False),
        (1, False, True),
        (1, True, True),
        (130, True, False),
        # What asyncio says of a process whose end a Ctrl-C kept it from seeing.
        (255, True, False),
        (255, False, True),
    ],
)
def test_which_ends_fail(status: int, is_ending: bool, fails: bool) -> None:
    from launch import LaunchContext
    from launch.actions import ExecuteProcess
    from launch.events.process import ProcessExited

    from aerarm_ros.launch_parts import after

    process = ExecuteProcess(cmd=['true'])
    context = LaunchContext()
    context._set_is_shutdown(is_ending)
    names = {'name': 'true-1', 'cmd': ['true'], 'cwd': None, 'env': None, 'pid': 1}
    event = ProcessExited(returncode=status, action=process, **names)
    action = after(process, 'it').event_handler.handle(event, context)
    assert (action is not None) == fails


@pytest.mark.parametrize('before', [signal.default_int_handler, signal.SIG_IGN])
def test_an_interrupt_is_left_to_the_event_loop_of_launch(before: Any) -> None:
    from launch import LaunchContext

    from aerarm_ros.launch_parts import check_first

    own = signal.signal(signal.SIGINT, before)
    try:
        check_first().execute(LaunchContext())
        # Neither raised in what runs, nor ignored: Python writes it to the wakeup descriptor.
        signal.raise_signal(signal.SIGINT)
        assert callable(signal.getsignal(signal.SIGINT))
    finally:
        signal.signal(signal.SIGINT, own)


def test_arguments_that_name_packaged_files_become_their_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from launch import LaunchContext

    from aerarm_ros.launch_parts import check_first

    monkeypatch.chdir(tmp_path)
    context = LaunchContext()
    context.launch_configurations.update(
        params_file='config/parameters_fake.yaml', urdf='aerarm.urdf', namespace='config'
    )
    own = signal.getsignal(signal.SIGINT)
    try:
        check_first().execute(context)
    finally:
        signal.signal(signal.SIGINT, own)
    found = context.launch_configurations
    assert Path(found['params_file']).is_file()
    assert Path(found['urdf']).is_file()
    assert found['namespace'] == 'config'
