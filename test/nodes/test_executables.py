"""The installed commands, interrupted while they are still being imported."""

import signal
import subprocess
import sys

import pytest

from aerarm_ros import executables

# An installed command whose module takes its time.
COMMAND = """
import sys, time

class Slow:
    def find_spec(self, name, *_):
        if name == 'aerarm_ros.nodes.arm':
            print('importing', flush=True)
            time.sleep(60.0)

sys.meta_path.insert(0, Slow())
from aerarm_ros.executables import arm
sys.exit(arm())
"""


def test_ctrl_c_at_the_start_is_quiet() -> None:
    with subprocess.Popen(
        [sys.executable, '-c', COMMAND], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == 'importing\n'
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30.0)
    assert said == ''
    assert process.returncode == -signal.SIGINT  # 130 in a shell


def test_what_is_no_command_is_no_attribute() -> None:
    with pytest.raises(AttributeError):
        executables._private  # noqa: B018
