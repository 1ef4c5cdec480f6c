"""Child processes that buttons of the web page start: recorder, motion player and controller."""

from __future__ import annotations

import importlib
import re
import shutil
import tempfile
import threading
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.executables import command_modules, controllers
from aerarm_ros.ros.process.node_process import NodeProcess

_WORDS_MAX = 300  # characters of a program's last line
_LOG_PREFIX = re.compile(r'^\[[A-Z]+\] \[[0-9.]+\] \[[^]]*\]: ')


class ChildProgram:
    """Run one node at a time as a child process, and read the last line of its output.

    A player or controller calls the bridge's service `hold` before its process ends. If the page's
    process ends, the child process ends too.

    Parameters
    ----------
    namespace
        Namespace of the nodes.

    Attributes
    ----------
    name
        Name of the node that runs or ran last; '' before the first.
    """

    def __init__(self, namespace: str) -> None:
        self.name = ''
        self._arguments = ('--ros-args', '-r', f'__ns:={namespace}', '--')
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

    def start(self, name: str, parameters: Mapping[str, object]) -> None:
        """Start the node `name` with ROS parameters; raise RuntimeError if a node is running."""
        with self._starting:
            if self.runs:
                raise RuntimeError(f'{self.name} is already running: stop it first')
            if self._logs is None:  # not earlier: a page that cannot be served leaves no directory
                self._logs = Path(tempfile.mkdtemp(prefix='aerarm_view_'))
            log = self._logs / f'{name}.log'
            self.name, self._is_ending = name, False
            self._process = NodeProcess(name, self._arguments, parameters, log=log)

    def end(self) -> None:
        """Send the child process a request to end, without waiting for its end."""
        if self._process is not None and self.runs:
            self._is_ending = True
            self._process.ask_to_end()

    def last_output(self) -> str:
        """Return the last line that the node printed, with the exit status of a failed node."""
        if self._process is None:
            return ''
        lines = [line for line in self._process.tail(5).splitlines() if line.strip()]
        # A progress line is overwritten, so use its last version.
        words = _LOG_PREFIX.sub('', lines[-1].rsplit('\r', 1)[-1].strip()) if lines else ''
        words = words[:_WORDS_MAX]
        status = self._process.returncode
        return f'{words} (ended with {status})' if status not in (None, 0, 130) else words

    def close(self) -> None:
        """End the child process, wait until it has ended, and delete its output."""
        if self._process is not None:
            self._process.stop()
        if self._logs is not None:
            shutil.rmtree(self._logs, ignore_errors=True)


RANDOM = 'random motion'
_SPEED, _TOOL_SPEED = 'tool_velocity_max', 0.8  # [m/s] tool speed at the full speed limit
# Name of a bag, which cannot leave the directory.
_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.-]{0,60}')
_LARGEST = 1_000_000  # [bytes] largest trajectory file
_MOST_FILES = 200


class PageProgramError(ValueError):
    """Error for a program that the page cannot start; the message states the reason."""


class PagePrograms:
    """Start and stop at most one recorder, one motion player and one controller for the page.

    The page accepts no file paths: it accepts a plain name for a new bag in one directory, and
    plays only trajectories in that directory.

    Parameters
    ----------
    namespace
        Namespace of the page and its nodes.
    folder
        Directory of bags and trajectories.
    arm
        ROS parameters that select the files of the arm.
    drone_file
        File of the drone that carries the arm, '' without a drone.

    Attributes
    ----------
    recorder, player, controller
        Child process of each program.
    """

    def __init__(
        self, namespace: str, folder: Path, arm: Mapping[str, object], drone_file: str = ''
    ) -> None:
        self.recorder = ChildProgram(namespace)
        self.player = ChildProgram(namespace)
        self.controller = ChildProgram(namespace)
        self._folder = folder.resolve()
        self._arm = {key: value for key, value in arm.items() if value}
        self._drone = {'drone_file': drone_file, 'base_motion': 'free'} if drone_file else {}

    def trajectories(self) -> tuple[str, ...]:
        """Return the names of the random motion and of the trajectory files in the directory."""
        names = []
        for path in sorted(self._folder.glob('*.yaml'))[:_MOST_FILES]:
            with suppress(OSError):
                if _is_trajectory(path, path.stat().st_mtime_ns):
                    names.append(path.name)
        return (RANDOM, *names)

    def record(self, name: str) -> str:
        """Start recording a new bag named `name`, and return the bag's path.

        Raises PageProgramError for an invalid name, and RuntimeError if the recorder is running.
        """
        if not _NAME.fullmatch(name):
            raise PageProgramError('invalid bag name: use letters, digits, _ - and .')
        bag = self._folder / name
        if bag.exists():
            raise PageProgramError(f'the bag {bag} already exists: choose another name')
        self.recorder.start('recorder', {'bag': bag})
        return str(bag)

    def play(self, name: str) -> None:
        """Start playing the motion `name`, one of the names that `trajectories` returns.

        Raises PageProgramError for an unknown name, and RuntimeError if the player is running.
        """
        if name not in self.trajectories():
            raise PageProgramError(
                f'the folder {self._folder} has no trajectory {name!r}: select a trajectory from '
                'the list'
            )
        chosen = {'seed': 1} if name == RANDOM else {'trajectory': self._folder / name}
        self.player.start('excitation', {**self._arm, **chosen})

    def control(self, name: str, speed_share: float) -> None:
        """Start the controller `name`, with a tool speed limit of `speed_share` times 0.8 m/s.

        Raises PageProgramError for an unknown name, and RuntimeError if a controller is running.
        """
        if name not in controllers():
            raise PageProgramError(f'unknown controller {name!r}: select one of the listed ones')
        speed = {_SPEED: speed_share * _TOOL_SPEED} if _has_tool_target(name) else {}
        self.controller.start(name, {**self._arm, **self._drone, **speed})

    def close(self) -> None:
        """End all programs: first the player, then the controller, last the recorder."""
        for program in (self.player, self.controller, self.recorder):
            program.close()


def _has_tool_target(name: str) -> bool:
    module = importlib.import_module(command_modules()[name])
    return any(parameter.name == _SPEED for parameter in module.PARAMETERS)


@lru_cache(maxsize=_MOST_FILES)
def _is_trajectory(path: Path, modified_ns: int) -> bool:
    if path.stat().st_size >= _LARGEST:
        return False
    try:
        TrajectoryFile.load(path)
    except ExcitationError:
        return False
    return True
