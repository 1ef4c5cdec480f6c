"""Run an executable to its end, for tests of its result instead of its start.

Importing the libraries of the executables takes most of a second. One process imports them once
and forks for every run, which has its own process, command line and exit.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from aerarm_ros.executables import command_modules, program
from aerarm_ros.ros.process.node_process import parameter_arguments, ros_environment
from aerarm_ros.ros.process.process_end import die_with_parent

_PATIENCE = 600.0  # [s]
_NODES = 'aerarm_ros.nodes'
# Modules that executables import after they have parsed their command line.
_LATE = (
    'aerarm_ros.ros.programs.design_run',
    'aerarm_ros.ros.programs.identifier_compare',
    'aerarm_ros.ros.programs.identifier_run',
    'aerarm_ros.ros.programs.identifier_run',
    'aerarm_ros.ros.programs.payload_replay',
)
_servers: list[subprocess.Popen[str]] = []


def run(
    name: str,
    *arguments: object,
    parameters: Mapping[str, object] | None = None,
    cwd: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run the module of a command with arguments and parameters, in this environment.

    The run is killed after ten minutes.
    """
    server = _server()
    assert server.stdin is not None
    assert server.stdout is not None
    given = [*map(str, arguments), *parameter_arguments(parameters or {})]
    with tempfile.TemporaryDirectory() as folder:
        said = [Path(folder, stream) for stream in ('stdout', 'stderr')]
        request = {
            'module': program(name, given),
            'arguments': given,
            'cwd': str(cwd or Path.cwd()),
            'environment': ros_environment(),
            'said': [str(file) for file in said],
        }
        server.stdin.write(json.dumps(request) + '\n')
        server.stdin.flush()
        status = int(server.stdout.readline())
        texts = [file.read_text() for file in said]
    return subprocess.CompletedProcess([name, *given], status, *texts)


def _server() -> subprocess.Popen[str]:
    if not _servers:
        command = [sys.executable, __file__, str(os.getpid())]
        pipe = subprocess.PIPE
        server = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        _servers.append(server)
        atexit.register(server.kill)
    return _servers[0]


# The process that forks.


def _serve() -> None:
    """Answer each request, a line, with its exit status."""
    die_with_parent(int(sys.argv[1]))
    for module in (*command_modules().values(), *_LATE):
        importlib.import_module(module)
    # They run as programs, so they must not be imported before.
    for module in [name for name in sys.modules if name.startswith(f'{_NODES}.')]:
        del sys.modules[module]
    gc.freeze()  # otherwise every process scans all of it at its end
    requests, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), 'w')
    while line := requests.readline():
        server = os.getpid()
        pid = os.fork()
        if pid == 0:
            die_with_parent(server)
            requests.close()
            answers.close()
            _become(**json.loads(line))
            return
        print(_status(pid), file=answers, flush=True)


def _become(
    module: str, arguments: list[str], cwd: str, environment: dict[str, str], said: list[str]
) -> None:
    """Run the program in this process; its exception ends the process as usual."""
    with contextlib.ExitStack() as stack:
        for descriptor, file in ((0, os.devnull), *enumerate(said, 1)):
            stream = stack.enter_context(open(file, 'r+' if descriptor == 0 else 'w'))
            os.dup2(stream.fileno(), descriptor)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    if not module.startswith(f'{_NODES}.'):
        sys.exit(importlib.import_module(module).main())
    runpy.run_module(module, run_name='__main__', alter_sys=True)


def _status(pid: int) -> int:
    """Wait for the end of a process; return its status, or minus the signal that ended it."""
    deadline = time.monotonic() + _PATIENCE
    while True:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > deadline:
            os.kill(pid, signal.SIGKILL)
        time.sleep(5e-3)


if __name__ == '__main__':
    _serve()
