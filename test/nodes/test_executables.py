"""Installed commands: interruption during their imports, and their threads."""

import os
import signal
import subprocess
import sys

import pytest

from aerarm_ros import executables
from aerarm_ros.realtime.scheduling import THREAD_VARIABLES
from aerarm_ros.ros.process.process_end import INTERRUPTED, USER_ERROR

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


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        ([], 'executables: the command is missing: choose one of arm, base_reaction'),
        (['fake_hardwar'], "executables: 'fake_hardwar' is not a command: choose one of arm, "),
    ],
)
def test_wrong_command_lines_print_one_line(arguments: list[str], told: str) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.executables', *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120.0)
    assert (done.returncode, done.stdout) == (USER_ERROR, '')
    assert done.stderr.startswith(told)
    assert done.stderr.count('\n') == 1


def test_ctrl_c_at_the_start_is_quiet() -> None:
    with subprocess.Popen(
        [sys.executable, '-c', COMMAND], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == 'importing\n'
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60.0)
    assert said == ''
    assert process.returncode == INTERRUPTED


def test_unknown_commands_are_no_attributes() -> None:
    with pytest.raises(AttributeError):
        executables._private  # noqa: B018


# Those that need most, one after the other.
HELPED = """
import sys
from aerarm_ros import executables
for name in ('demo', 'excitation_designer', 'fake_hardware', 'motion_planner', 'view'):
    sys.argv = [name, '--help']
    try:
        getattr(executables, name)()
    except SystemExit:
        pass
heavy = 'mujoco', 'pinocchio', 'rclpy', 'scipy', 'sensor_msgs', 'viser'
print([module for module in heavy if hasattr(sys.modules.get(module), '__file__')])
"""


def test_help_loads_no_ros_no_physics_and_no_algebra() -> None:
    done = subprocess.run([sys.executable, '-c', HELPED], capture_output=True, text=True)
    assert done.stderr == ''
    assert done.stdout.count('usage: ') == 5
    assert done.stdout.endswith('[]\n')


@pytest.mark.parametrize('rule', [('-r', '-h'), ('-p', 'frame:=tool', '-h')])
def test_h_among_ros_arguments_is_one_clear_line(rule: tuple[str, ...]) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'view', '--ros-args', *rule]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0)
    assert done.returncode in (1, USER_ERROR)
    assert 'Traceback' not in done.stderr
    assert 'view: ' in done.stderr


def threads_added_by(module: str) -> int:
    """Count them in the environment that users have."""
    program = f"""
import os, rclpy
before = os.listdir('/proc/self/task')
import {module}, numpy
numpy.linalg.solve(numpy.eye(300), numpy.ones(300))
print(len(os.listdir('/proc/self/task')) - len(before))
"""
    environment = {k: v for k, v in os.environ.items() if k not in THREAD_VARIABLES}
    command = [sys.executable, '-c', program]
    return int(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)


@pytest.mark.skipif(os.cpu_count() == 1, reason='one core: NumPy has no threads here anyway')
def test_executables_use_one_thread_for_linear_algebra() -> None:
    assert threads_added_by('numpy') > 0
    assert threads_added_by('aerarm_ros.nodes.controllers.impedance_control') == 0


# A stop signal while MuJoCo's window library looks for its version prints a traceback.
WITH_PHYSICS = """
import sys
from aerarm_ros.nodes import fake_hardware
import mujoco
print(mujoco.MjModel.from_xml_string('<mujoco/>').nbody, 'glfw' in sys.modules)
"""


def test_physics_loads_no_window_library() -> None:
    command = [sys.executable, '-c', WITH_PHYSICS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == '1 False\n'
