"""Fixtures of the tests of several packages."""

import csv
import fcntl
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from answering_bridges import destroy_bridges
from forked_executable import FORKING
from hypothesis import settings
from own_domain import own_domain
from quick_spinning import release_nodes
from rclpy.node import Node

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.ros.process import node_process
from aerarm_ros.ros.process.node_process import find_log_directory, ros_environment
from aerarm_ros.ros.process.process_end import ExitLimit

ROOT = Path(__file__).resolve().parents[1]
NOT_IN_WHEEL = ('.*', '*.pyc', 'benchmarks', 'build', 'docs', 'mutants', 'output', 'test')

# Equal examples in each run, without a time limit, because the machine may be busy.
settings.register_profile('suite', deadline=None, derandomize=True)
settings.load_profile('suite')
# The tests start hundreds of processes, each of which would compile the package again.
sys.dont_write_bytecode = False
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)
# The tests may be started without HOME.
find_log_directory()

# A shell script's background job ignores Ctrl-C, and so would every process started by a test.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# The process that starts the tests may also ignore SIGQUIT, SIGHUP (nohup) and others. The tests
# keep this, but the processes that they start get the default handlers.
_LEFT = {signal.SIGPIPE, signal.SIGXFSZ}  # Python itself ignores them
# A handler would run after the instruction that crashed, which never ends.
_BY_DEFAULT = {signal.SIGCHLD, signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}
_LEFT |= {signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU}  # a background job continues
for number in signal.valid_signals() - _LEFT:
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.SIG_DFL if number in _BY_DEFAULT else lambda *_: None)
# Started processes inherit blocked signals.
signal.pthread_sigmask(signal.SIG_SETMASK, ())


@pytest.fixture(scope='session')
def table_a1() -> dict[str, np.ndarray]:
    """Thesis table A.1: the 48 parameters of each column, by column name."""
    with (Path(__file__).parent / 'data' / 'table_a1.csv').open() as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key]) for row in rows]) for key in ('CAD', 'SLSQP', 'SA')}


@pytest.fixture(scope='session')
def example_urdf() -> Callable[[str], Path]:
    """Return a function that finds a URDF of the package example-robot-data by file name."""

    def find(name: str) -> Path:
        for file in files('example-robot-data') or ():
            if file.name == name and file.parent.name == 'urdf':
                return Path(str(file.locate()))
        raise FileNotFoundError(f'example-robot-data has no {name}')

    return find


@pytest.fixture(scope='session')
def made_once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str, Callable[[Path], None]], Path]:
    """Return a function that returns a named directory, filled once by `fill(folder)`.

    Parallel test processes share these directories, for data that are slow to create and only
    read.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if 'PYTEST_XDIST_WORKER' in os.environ else base

    def make(name: str, fill: Callable[[Path], None]) -> Path:
        folder, filled = shared / name, shared / f'{name}.filled'
        with (shared / f'{name}.lock').open('w') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not filled.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                filled.touch()
        return folder

    return make


@pytest.fixture(scope='session')
def wheel(made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Return the wheel of the suite, as `pip install .` builds it."""

    def build(folder: Path) -> None:
        # A copy, because setuptools writes beside setup.py.
        shutil.copytree(ROOT, folder / 'source', ignore=shutil.ignore_patterns(*NOT_IN_WHEEL))
        command = [sys.executable, '-m', 'pip', 'wheel', '--quiet', '--no-deps', '-w', folder]
        subprocess.run([*command, folder / 'source'], check=True)

    return next(made_once('wheel', build).glob('*.whl'))


@pytest.fixture(scope='session')
def robot() -> Robot:
    """Return the arm; other packages override this fixture."""
    return load_robot()


@pytest.fixture(scope='session', autouse=True)
def forked_nodes() -> Iterator[None]:
    """Fork the nodes of `NodeProcess` from a process that has imported their libraries."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(node_process, 'subprocess', FORKING)
        yield


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Give this process, and the processes it starts, an unused ROS domain.

    Return the variables, for processes with an environment of their own.
    """
    variables = own_domain()
    environment = ros_environment(variables)
    for name in (*variables, 'FASTRTPS_DEFAULT_PROFILES_FILE'):
        monkeypatch.setenv(name, environment[name])
    return variables


@pytest.fixture
def ros_node(ros_domain: dict[str, str]) -> Iterator[Node]:
    """Return a node in an unused domain."""
    rclpy.init(args=[])
    node = rclpy.create_node('test')
    yield node
    release_nodes()
    destroy_bridges()
    with ExitLimit(1):  # A worker that Fast DDS blocks for ever would block the whole run.
        node.destroy_node()
        rclpy.shutdown()


@pytest.fixture
def make_node(ros_domain: dict[str, str]) -> Iterator[Callable[..., Any]]:
    """Return a function that makes a node of a class with parameters, in this process."""
    with ExitStack() as stack:

        def make(kind: Callable[[], Any], **parameters: object) -> Any:
            given = [word for name, x in parameters.items() for word in ('-p', f'{name}:={x}')]
            rclpy.init(args=['--ros-args', *given])
            stack.callback(rclpy.try_shutdown)
            node = kind()
            stack.callback(node.close)
            return node

        yield make
