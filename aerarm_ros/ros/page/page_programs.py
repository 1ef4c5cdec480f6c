"""Recorder, player and controller as the page runs them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from aerarm_ros.excitation.design.trajectory_file import TrajectoryFile
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.ros.page.child_program import ChildProgram

CONTROLLERS = ('computed_torque', 'gravity_compensation', 'kinematic_control', 'impedance_control')
RANDOM = 'random motion'
_CARTESIAN = ('kinematic_control', 'impedance_control')
_TOOL_SPEED = 0.8  # [m/s] at the whole speed limit
# A name of a bag, and no way out of the folder.
_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.-]{0,60}')
_LARGEST = 1_000_000  # [bytes] of a trajectory's file
_MOST_FILES = 200


class PageProgramError(ValueError):
    """A program cannot be started so; the message says why."""


class PagePrograms:
    """At most one recorder, one player and one controller.

    Nobody at the page names a file: bags lie in the folder, under plain names, and what is played
    is chosen of the trajectories in it.

    Parameters
    ----------
    namespace
        Of the page, for the nodes.
    folder
        Where bags and trajectories are.
    arm
        Parameters that name the files of the arm.
    drone_file
        Drone that carries the arm, '' if none is known.

    Attributes
    ----------
    recorder, player, controller
        The programs.
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
        self._known: dict[tuple[str, int], bool] = {}

    def trajectories(self) -> tuple[str, ...]:
        """Return the names of the trajectories that may be played."""
        names = []
        for path in sorted(self._folder.glob('*.yaml'))[:_MOST_FILES]:
            try:
                facts = path.stat()
            except OSError:
                continue
            key = (path.name, facts.st_mtime_ns)
            if key not in self._known:
                self._known[key] = facts.st_size < _LARGEST and _is_trajectory(path)
            if self._known[key]:
                names.append(path.name)
        return (RANDOM, *names)

    def record(self, name: str) -> str:
        """Record a bag of that name, and return where; raises PageProgramError, RuntimeError."""
        if not _NAME.fullmatch(name):
            raise PageProgramError('a bag is named by letters, digits, _ - and .')
        bag = self._folder / name
        if bag.exists():
            raise PageProgramError(f'{bag} exists: give another name')
        self.recorder.start('recorder', {'bag': bag})
        return str(bag)

    def play(self, name: str) -> None:
        """Play one of `trajectories`; raises PageProgramError, RuntimeError."""
        if name not in self.trajectories():
            raise PageProgramError(f'there is no trajectory {name!r} in {self._folder}')
        chosen = {'seed': 1} if name == RANDOM else {'trajectory': self._folder / name}
        self.player.start('excitation', {**self._arm, **chosen})

    def control(self, name: str, speed_share: float) -> None:
        """Start a controller; raises PageProgramError, RuntimeError."""
        if name not in CONTROLLERS:
            raise PageProgramError(f'there is no controller {name!r}')
        speed = {'tool_velocity_max': speed_share * _TOOL_SPEED} if name in _CARTESIAN else {}
        self.controller.start(name, {**self._arm, **self._drone, **speed})

    def close(self) -> None:
        """End what runs: first what moves the arm."""
        for program in (self.player, self.controller, self.recorder):
            program.close()


def _is_trajectory(path: Path) -> bool:
    try:
        TrajectoryFile.load(path)
    except ExcitationError:
        return False
    return True
