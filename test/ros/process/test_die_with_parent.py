"""Commands started by ROS's launch, after launch has ended; a test process replaces launch."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

# Starts a bridge as launch does, says who it is, and lives on. With a word, it starts it by way
# of another process, and with `late` that one first waits until launch is gone.
LAUNCH = """
import os, subprocess, sys, time
from aerarm_ros.ros.process.process_end import LAUNCH_PID
environment = {**os.environ, LAUNCH_PID: str(os.getpid())}
say = 'import os; print(os.getpid(), flush=True); '
command = [sys.executable, '-c', say + sys.argv[2]]
if sys.argv[1] == 'through':
    between = 'import subprocess, sys; subprocess.run(sys.argv[1:])'
    command = [sys.executable, '-c', between, *command]
subprocess.Popen(command, env=environment)
time.sleep(60.0)
"""
BRIDGE = (
    'import sys; from aerarm_ros.executables import fake_hardware; '
    'sys.argv[1:] = ["--ros-args", "-p", "truth_file:={}"]; sys.exit(fake_hardware())'
)
LATE = (
    'import time; from aerarm_ros.ros.process.process_end import die_with_launch; '
    'time.sleep(1.0); die_with_launch(); print("begun", flush=True)'
)


def is_gone(pid: int) -> bool:
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except OSError:
        return True
    return state == 'Z'


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def start(how: str, what: str) -> tuple[subprocess.Popen, int]:
    """Start a launch; return it and the process that it has started."""
    launch = subprocess.Popen(
        [sys.executable, '-c', LAUNCH, how, what], stdout=subprocess.PIPE, text=True
    )
    assert launch.stdout
    return launch, int(launch.stdout.readline())


def test_a_command_does_not_start_after_its_launch_has_ended() -> None:
    launch, late = start('itself', LATE)
    launch.kill()
    launch.wait(60.0)
    assert launch.stdout
    assert launch.stdout.read() == ''  # to its end: nobody is left who could write
    until(lambda: is_gone(late))


def test_processes_of_other_parents_survive(ros_domain: dict[str, str], tmp_path: Path) -> None:
    truth = tmp_path / 'truth.yaml'
    launch, bridge = start('through', BRIDGE.format(truth))
    until(truth.exists)
    launch.kill()
    launch.wait(60.0)
    time.sleep(0.5)
    assert not is_gone(bridge)
    os.kill(bridge, signal.SIGTERM)
    until(lambda: is_gone(bridge))
