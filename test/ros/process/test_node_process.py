"""Child processes end with the process that started them, however it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aerarm_ros.ros.process import node_process
from aerarm_ros.ros.process.node_process import NodeProcess

PARENT = """
import sys, time
from pathlib import Path
from aerarm_ros.ros.process.node_process import NodeProcess
child = NodeProcess('fake_hardware', log=Path(sys.argv[1]))
print(child.pid, flush=True)
time.sleep(3600.0)
"""


@pytest.fixture(autouse=True)
def real_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start processes as users do."""
    monkeypatch.setattr(node_process, 'subprocess', subprocess)


def wait_for(condition, timeout: float = 60.0) -> bool:
    deadline = time.monotonic() + timeout
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return condition()


def is_running(pid: int) -> bool:
    try:
        return ') Z ' not in Path(f'/proc/{pid}/stat').read_text()
    except OSError:
        return False


@pytest.mark.parametrize('is_up', [False, True], ids=['while it starts', 'while it runs'])
def test_a_killed_parent_leaves_no_child(
    ros_domain: dict[str, str], tmp_path: Path, is_up: bool
) -> None:
    log = tmp_path / 'log'
    command = [sys.executable, '-c', PARENT, str(log)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        try:
            child = int(parent.stdout.readline())
            assert not is_up or wait_for(lambda: ': unhomed' in log.read_text())
            assert is_running(child)
        finally:
            parent.kill()
    assert wait_for(lambda: not is_running(child)), log.read_text()
    assert 'Traceback' not in log.read_text()
    # It had time to switch the motors off.
    assert not is_up or 'cycles' in log.read_text()


def test_ctrl_c_of_a_terminal_does_not_reach_it(ros_domain: dict[str, str], tmp_path: Path) -> None:
    with NodeProcess('fake_hardware', log=tmp_path / 'log') as process:
        assert os.getpgid(process.pid) == process.pid != os.getpgrp()


def test_a_process_ended_during_its_start_logs_nothing(
    ros_domain: dict[str, str], tmp_path: Path
) -> None:
    with NodeProcess('identifier', log=tmp_path / 'log') as process:
        assert process.stop() in (-signal.SIGTERM, 0)
    assert process.tail() == ''
    assert process.log is not None
    process.log.write_text('first\n' + 'x' * 100_000 + '\nlast\n')
    assert process.tail(1) == 'last'
    assert len(process.tail(3)) <= 65536  # a log of days is not read as a whole
