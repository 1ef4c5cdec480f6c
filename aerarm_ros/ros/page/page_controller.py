"""Child process of the web page that runs a controller."""

from __future__ import annotations

import importlib
import re
import shutil
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path

from aerarm_ros.executables import command_modules, controllers
from aerarm_ros.ros.process.node_process import NodeProcess

_WORDS_MAX = 300  # characters of the controller's last line
_LOG_PREFIX = re.compile(r'^\[[A-Z]+\] \[[0-9.]+\] \[[^]]*\]: ')
_SPEED, _TOOL_SPEED = 'tool_velocity_max', 0.8  # [m/s] tool speed at the full speed limit


class PageController:
    """Run one controller at a time as a child process, and read the last line of its output.

    A controller calls the bridge's service `hold` before its process ends. If the page's process
    ends, the child process ends too.

    Parameters
    ----------
    namespace
        Namespace of the page and its controllers.
    arm
        ROS parameters that select the files of the arm.
    drone_file
        File of the drone that carries the arm, '' without a drone.

    Attributes
    ----------
    name
        Name of the controller that runs or ran last; '' before the first.
    """

    def __init__(self, namespace: str, arm: Mapping[str, object], drone_file: str = '') -> None:
        self.name = ''
        self._arguments = ('--ros-args', '-r', f'__ns:={namespace}', '--')
        self._arm = {key: value for key, value in arm.items() if value}
        self._drone = {'drone_file': drone_file, 'base_motion': 'free'} if drone_file else {}
        self._logs: Path | None = None
        self._process: NodeProcess | None = None
        self._is_ending = False
        self._starting = threading.Lock()  # several threads serve clicks

    @property
    def runs(self) -> bool:
        """Whether the child process is running."""
        return self._process is not None and self._process.returncode is None

    @property
    def is_ending(self) -> bool:
        """Whether the child process is still running after a request to end."""
        return self._is_ending and self.runs

    def start(self, name: str, speed_share: float) -> None:
        """Start the controller `name`, with a tool speed limit of `speed_share` times 0.8 m/s.

        Raises ValueError for an unknown name, and RuntimeError if a controller is running.
        """
        if name not in controllers():
            raise ValueError(f'unknown controller {name!r}: select one of the listed ones')
        speed = {_SPEED: speed_share * _TOOL_SPEED} if _has_tool_target(name) else {}
        with self._starting:
            if self.runs:
                raise RuntimeError(f'{self.name} is already running: stop it first')
            if self._logs is None:  # not earlier: a page that cannot be served leaves no directory
                self._logs = Path(tempfile.mkdtemp(prefix='aerarm_view_'))
            self.name, self._is_ending = name, False
            given = {**self._arm, **self._drone, **speed}
            log = self._logs / f'{name}.log'
            self._process = NodeProcess(name, self._arguments, given, log=log)

    def end(self) -> None:
        """Send the child process a request to end, without waiting for its end."""
        if self._process is not None and self.runs:
            self._is_ending = True
            self._process.ask_to_end()

    def last_output(self) -> str:
        """Return the last line that the controller printed, with the exit status of a failure."""
        if self._process is None:
            return ''
        lines = [line for line in self._process.tail(5).splitlines() if line.strip()]
        words = _LOG_PREFIX.sub('', lines[-1].strip())[:_WORDS_MAX] if lines else ''
        status = self._process.returncode
        return f'{words} (ended with {status})' if status not in (None, 0, 130) else words

    def close(self) -> None:
        """End the child process, wait until it has ended, and delete its output."""
        if self._process is not None:
            self._process.stop()
        if self._logs is not None:
            shutil.rmtree(self._logs, ignore_errors=True)


def _has_tool_target(name: str) -> bool:
    module = importlib.import_module(command_modules()[name])
    return any(parameter.name == _SPEED for parameter in module.PARAMETERS)
