"""Run executables without their imports, for tests of what they do instead of their start.

Importing the libraries of the executables takes most of a second. One process imports them once
and forks for every run, which has its own process, command line and exit.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.type_support import check_for_type_support

from aerarm_msgs_py.topics import TOPICS
from aerarm_ros.executables import command_modules, program
from aerarm_ros.ros.process.node_process import parameter_arguments, ros_environment
from aerarm_ros.ros.process.process_end import LAUNCH_PID, die_with_parent

_PATIENCE = 600.0  # [s]
_NODES = 'aerarm_ros.nodes'
_EXECUTABLES = 'aerarm_ros.executables'
# Modules that executables import after they have parsed their command line.
_LATE = (
    'aerarm_ros.ros.programs.design_run',
    'aerarm_ros.ros.programs.identifier_run',
    'aerarm_ros.ros.programs.payload_replay',
)
_servers: list[subprocess.Popen[str]] = []
_asking = threading.Lock()
_ENVIRONMENT = dict(os.environ)


def run(
    name: str,
    *arguments: object,
    parameters: Mapping[str, object] | None = None,
    cwd: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run the module of a command, or a script, with arguments and parameters.

    The run is killed after ten minutes.
    """
    given = [*map(str, arguments), *parameter_arguments(parameters or {})]
    module = name if name.endswith('.py') else program(name, given)
    with tempfile.TemporaryDirectory() as folder:
        said = [Path(folder, stream) for stream in ('stdout', 'stderr')]
        process = ForkedProcess(module, given, ros_environment(), said, cwd)
        try:
            status = process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            status = process.wait()
        texts = [file.read_text() for file in said]
    return subprocess.CompletedProcess([name, *given], status, *texts)


class ForkedProcess:
    """A fork that runs a module or script; the part of `subprocess.Popen` that its users need."""

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        said: Sequence[Path | None],
        cwd: Path | None = None,
    ) -> None:
        self.returncode: int | None = None
        self._polling = threading.Lock()
        self.pid = _ask(
            module=module,
            arguments=list(arguments),
            cwd=str(cwd or Path.cwd()),
            environment=dict(environment),
            said=[file and str(file) for file in said],
        )

    def poll(self) -> int | None:
        with self._polling:
            if self.returncode is None:
                self.returncode = _ask(pid=self.pid)
            return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        deadline = None if timeout is None else time.monotonic() + timeout
        while self.poll() is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired('', timeout)
            time.sleep(5e-3)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def _popen(
    command: Sequence[str], *, env: Mapping[str, str], stdout: IO[bytes] | None, **other: Any
) -> ForkedProcess | subprocess.Popen[bytes]:
    """Start the node of a `NodeProcess`."""
    if _early(env) != _early(_ENVIRONMENT):
        return subprocess.Popen(command, env=env, stdout=stdout, **other)
    log = Path(stdout.name) if stdout else None
    environment = {**env, LAUNCH_PID: str(_server().pid)}
    return ForkedProcess(_EXECUTABLES, command[3:], environment, [log, log])


# In place of the module `subprocess` in `node_process`.
FORKING = SimpleNamespace(**{**vars(subprocess), 'Popen': _popen})


def _early(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that act before a program imports anything.

    Whether imports are written as bytecode makes no difference to a fork.
    """
    found = {k: v for k, v in environment.items() if k.startswith(('LD_', 'PYTHON'))}
    found.pop('PYTHONDONTWRITEBYTECODE', None)
    return found


def _ask(**request: object) -> Any:
    with _asking:
        server = _server()
        assert server.stdin is not None
        assert server.stdout is not None
        server.stdin.write(json.dumps(request) + '\n')
        server.stdin.flush()
        return json.loads(server.stdout.readline())


def _server() -> subprocess.Popen[str]:
    if not _servers:
        command = [sys.executable, __file__]
        pipe = subprocess.PIPE
        server = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        _servers.append(server)
        atexit.register(server.kill)
    return _servers[0]


# The process that forks.


def _serve() -> None:
    """Answer each request, a line, with the id of a new process or the status of an old one.

    The end of the input ends this process. `die_with_parent` would end it with the thread that
    started it, which may be a short one.
    """
    for module in (*command_modules().values(), *_LATE):
        importlib.import_module(module)
    for kind in (ParameterEvent, *(topic.type for topic in TOPICS.values())):
        check_for_type_support(kind)
    # They run as programs, so they must not be imported before.
    for module in [name for name in sys.modules if name.startswith(f'{_NODES}.')]:
        del sys.modules[module]
    gc.freeze()  # otherwise every process scans all of it at its end
    requests, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), 'w')
    while line := requests.readline():
        request = json.loads(line)
        server = os.getpid()
        if 'pid' in request:
            pid, status = os.waitpid(request['pid'], os.WNOHANG)
            answer = os.waitstatus_to_exitcode(status) if pid else None
        elif (answer := os.fork()) == 0:
            die_with_parent(server)
            requests.close()
            answers.close()
            _become(**request)
            return
        print(json.dumps(answer), file=answers, flush=True)


def _become(
    module: str, arguments: list[str], cwd: str, environment: dict[str, str], said: list[str | None]
) -> None:
    """Run the program in this process; its exception ends the process as usual."""
    os.setpgid(0, 0)
    os.dup2(os.open(os.devnull, os.O_RDWR), 0)
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
    files = {file: os.open(file, flags, 0o644) for file in set(said) if file}
    for descriptor, file in enumerate(said, 1):
        os.dup2(files[file] if file else 2, descriptor)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    if module.endswith('.py'):
        sys.path.insert(0, str(Path(module).parent))
        runpy.run_path(module, run_name='__main__')
        sys.exit()
    if module == _EXECUTABLES:
        sys.exit(importlib.import_module(module)._run_named())
    sys.exit(importlib.import_module(module).main())


if __name__ == '__main__':
    _serve()
