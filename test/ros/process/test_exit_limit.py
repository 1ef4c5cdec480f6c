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
import ctypes, mmap, os, sys, time
c, page = ctypes.CDLL(None), mmap.mmap(-1, mmap.PAGESIZE, prot=7)
page.write(bytes.fromhex('{SPIN}'))
ctypes.pythonapi.Py_IncRef(ctypes.py_object(page))
spin = ctypes.CFUNCTYPE(None)(ctypes.addressof(ctypes.c_char.from_buffer(page)))
from aerarm_ros.ros.process.process_end import ExitLimit, exit_within
"""
AT_EXIT = 'c.__cxa_atexit(ctypes.cast(spin, ctypes.c_void_p), None, None)\n'
# The limit itself is long for a test.
SHORT = 'ExitLimit.__init__.__defaults__ = exit_within.__defaults__ = (0.3,)\n'
ALONE = """
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
with ExitLimit(7, 0.3): spin()
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
IS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason='real-time priority needs rights')


@pytest.mark.parametrize(
    ('code', 'status'),
    [
        ('exit_within(7, 1000.0); sys.exit(3)', 3),
        (AT_EXIT + 'with ExitLimit(7, 0.3): spin()', 7),
        ('with ExitLimit(7, 0.1): pass\nwhile time.process_time() < 1.0: pass', 0),
        pytest.param(AT_EXIT + ALONE, 7, marks=IS_ROOT),
        (AT_EXIT + SHORT + COMMAND.format('computed_torque', ['--help']), 0),
        (AT_EXIT + SHORT + COMMAND.format('arm', ['no_such_order']), 2),
        (AT_EXIT + SHORT + NODE.format('self.status = 3'), 3),
        (AT_EXIT + SHORT + NODE.format('raise ArithmeticError'), 1),
        (AT_EXIT + SHORT + NODE.format('raise KeyboardInterrupt'), 0),
    ],
    ids=[
        *('ends in time', 'while an object is closed', 'after the limit', 'busy in real time'),
        *('help', 'wrong order', 'status of a node', 'defect of a node', 'interrupted node'),
    ],
)
def test_a_process_ends_with_its_status(ros_domain: dict[str, str], code: str, status: int) -> None:
    done = subprocess.run([sys.executable, '-c', SPINNING + code], timeout=300.0)
    assert done.returncode == status


def test_a_node_that_another_has_started_has_a_limit(tmp_path: Path) -> None:
    # Python runs that as it starts.
    (tmp_path / 'sitecustomize.py').write_text(SPINNING + AT_EXIT + SHORT)
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get('PYTHONPATH')]))
    with NodeProcess(
        'fake_hardware', ('--help',), environment={'PYTHONPATH': path}, log=tmp_path / 'log'
    ) as node:
        assert node.wait(300.0) == 0
        assert 'pace' in (tmp_path / 'log').read_text()
