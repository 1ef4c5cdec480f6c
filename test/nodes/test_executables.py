"""The installed commands, interrupted while they are still being imported."""

import signal
import subprocess
import sys

import pytest

from aerarm_ros import executables

# What an installed command is.
COMMAND = """
import sys
from aerarm_ros.executables import {name}
print('begin', flush=True)
sys.exit({name}())
"""


@pytest.mark.parametrize('name', ['fake_hardware', 'recorder', 'view'])
@pytest.mark.parametrize('delay', [0.02, 0.1, 0.3])
def test_ctrl_c_at_the_start_is_quiet(
    ros_domain: dict[str, str], name: str, delay: float, tmp_path
) -> None:
    command = [sys.executable, '-c', COMMAND.format(name=name)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    ) as process:
        assert process.stdout
        process.stdout.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(delay)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30.0)
    assert 'Traceback' not in said
    assert process.returncode in (0, 130)


def test_what_is_no_command_is_no_attribute() -> None:
    with pytest.raises(AttributeError):
        executables._private  # noqa: B018
