"""A process whose exit handler in the C library loops for ever."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.ros.process.node_process import NodeProcess

# A jump to itself.
SPIN = {'x86_64': 'ebfe', 'aarch64': '00000014'}.get(platform.machine())
pytestmark = pytest.mark.skipif(SPIN is None, reason='how this processor spins is not known here')
# `spin` is that as a function of C, which outlives Python.
SPINNING = f"""
import ctypes, mmap, sys
c, page = ctypes.CDLL(None), mmap.mmap(-1, mmap.PAGESIZE, prot=7)
page.write(bytes.fromhex('{SPIN}'))
ctypes.pythonapi.Py_IncRef(ctypes.py_object(page))
spin = ctypes.CFUNCTYPE(None)(ctypes.addressof(ctypes.c_char.from_buffer(page)))
c.__cxa_atexit(ctypes.cast(spin, ctypes.c_void_p), None, None)
"""
LIMIT = """
import sys, time
from aerarm_ros.ros.process import process_end as exit_limit
"""
# The limit itself is long for a test.
SHORT = """
from aerarm_ros.ros.process.process_end import ExitLimit, exit_within
ExitLimit.__init__.__defaults__ = exit_within.__defaults__ = (0.3,)
"""
COMMAND = 'from aerarm_ros.executables import {0}; sys.argv[1:] = {1}; sys.exit({0}())'
NODE = """
from aerarm_ros.ros.process.node_main import run_node
class Node:
    status = 0
    def run(self): {0}
    def close(self): spin()
sys.exit(run_node('script', Node, []))
"""


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False, timeout=300.0
    )


def test_one_that_ends_in_time_is_not_touched() -> None:
    done = run(f'{LIMIT}exit_limit.exit_within(7, 1000.0); print("done"); sys.exit(3)')
    assert (done.returncode, done.stdout, done.stderr) == (3, 'done\n', '')


def test_the_process_ends_while_an_object_is_being_closed() -> None:
    done = run(f'{SPINNING}{LIMIT}\nwith exit_limit.ExitLimit(7, 0.3): spin()')
    assert (done.returncode, done.stderr) == (7, '')


def test_a_closed_limit_no_longer_applies() -> None:
    busy = '\nwith exit_limit.ExitLimit(7, 0.1): pass\nwhile time.process_time() < 1.0: pass'
    assert run(f'{LIMIT}{busy}').returncode == 0


@pytest.mark.skipif(os.geteuid() != 0, reason='real-time priority needs rights')
def test_a_busy_loop_is_ended() -> None:
    alone = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
with exit_limit.ExitLimit(7, 0.3): spin()
"""
    assert run(SPINNING + LIMIT + alone).returncode == 7


@pytest.mark.parametrize(
    ('command', 'arguments', 'status'),
    [('computed_torque', ['--help'], 0), ('arm', ['no_such_order'], 2)],
)
def test_every_command_has_a_limit(command: str, arguments: list[str], status: int) -> None:
    done = run(SPINNING + SHORT + COMMAND.format(command, arguments))
    assert done.returncode == status
    assert done.stdout or done.stderr


@pytest.mark.parametrize(
    ('action', 'status'),
    [('self.status = 3', 3), ('raise ArithmeticError', 1), ('raise KeyboardInterrupt', 0)],
)
def test_a_node_that_cannot_be_closed_ends_with_its_status(
    ros_domain: dict[str, str], action: str, status: int
) -> None:
    assert run(SPINNING + SHORT + NODE.format(action)).returncode == status


def test_a_node_that_another_has_started_has_a_limit(tmp_path: Path) -> None:
    # Python runs that as it starts.
    (tmp_path / 'sitecustomize.py').write_text(SPINNING + SHORT)
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get('PYTHONPATH')]))
    with NodeProcess(
        'fake_hardware', ('--help',), environment={'PYTHONPATH': path}, log=tmp_path / 'log'
    ) as node:
        assert node.wait(300.0) == 0
        assert 'pace' in (tmp_path / 'log').read_text()
