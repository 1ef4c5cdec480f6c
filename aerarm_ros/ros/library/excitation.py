"""A motion worth recording, in one call."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.design.design_result import DesignResult
from aerarm_ros.excitation.design.design_specification import DesignSpecification
from aerarm_ros.excitation.design.trajectory_designer import TrajectoryDesigner
from aerarm_ros.excitation.planning.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings.excitation_config import (
    ExcitationConfig,
    load_excitation_config,
)
from aerarm_ros.excitation.settings.excitation_error import (
    DesignStoppedError,
    ExcitationError,
    InfeasibleError,
)
from aerarm_ros.ros.library.planned_excitation import PlannedExcitation


def plan_excitation(
    urdf: str | os.PathLike[str] | Robot | None = None,
    *,
    fundamental: float = 0.1,
    harmonics: int = 5,
    periods: int = 2,
    seconds: float = 10.0,
    seed: int = 1,
    config: str | os.PathLike[str] | None = None,
    room: str | os.PathLike[str] | None = None,
    bias: Sequence[float] | None = None,
    lock: Sequence[str] = (),
    package_directories: Sequence[str | os.PathLike[str]] = (),
    acceleration_limit: npt.ArrayLike = np.inf,
) -> PlannedExcitation:
    """Design a motion that makes an arm's parameters visible, within all its limits.

    Parameters
    ----------
    urdf : path or Robot, optional
        Of the arm; this package's by default.
    fundamental : float
        f0 [Hz].
    harmonics, periods : int
        N, and how many periods to play.
    seconds : float
        To search for; 0 takes the first random motion that is feasible.
    seed : int
        Of the random starts.
    config : path, optional
        Motors and gears; known for this package's arm.
    room : path, optional
        Surroundings and shares of the limits, as `config/excitation.yaml`; that file for this
        package's arm, and no surroundings for others.
    bias : (n,) sequence, optional
        Posture about which the arm moves [rad].
    lock : sequence of str
        Joints of the URDF that do not move.
    package_directories : sequence of paths
        Where `package://` meshes are looked for.
    acceleration_limit : float or (n,) array_like
        [rad/s^2], for an arm without motors and gears.

    Raises
    ------
    ConfigError, DescriptionError, ExcitationError
        If something can't be used, or no motion is feasible; the message says what to check.
    """
    if not (np.isfinite(seconds) and seconds >= 0.0):
        raise ExcitationError(f'seconds = {seconds:g} must be a time not below 0')
    if periods < 1:
        raise ExcitationError(f'periods = {periods} must be at least 1')
    lock = [lock] if isinstance(lock, str) else list(lock)
    own = urdf is None
    file = None if room is None else Path(room)
    settings = load_excitation_config(file) if file or own else ExcitationConfig()
    if bias is not None:
        settings = replace(settings, bias=tuple(float(value) for value in bias))
    known = own or config is not None
    arm = load_arm_config(None if config is None else Path(config)) if known else None
    if lock and (arm is not None or isinstance(urdf, Robot)):
        raise ExcitationError(
            f'lock = {", ".join(lock)}: goes with the path of a URDF, without config; else '
            'load_robot(urdf, locked=...) makes the robot to give'
        )
    if arm is not None and np.isfinite(acceleration_limit).any():
        raise ExcitationError(
            'acceleration_limit is for an arm without motors and gears: else they limit it'
        )
    robot = urdf if isinstance(urdf, Robot) else _robot(urdf, arm, lock)
    if arm is not None:
        setup = ExcitationSetup.of_arm(robot, arm, settings)
    else:
        folders = tuple(Path(folder) for folder in package_directories)
        setup = ExcitationSetup.of_robot(robot, settings, folders, acceleration_limit)
    specification = DesignSpecification(setup, fundamental, harmonics, seed=seed)
    return PlannedExcitation(specification, _designed(specification, seconds), periods)


def _robot(
    urdf: str | os.PathLike[str] | None, arm: ArmConfig | None, lock: Sequence[str]
) -> Robot:
    path = None if urdf is None else Path(urdf)
    if arm is None:
        return load_robot(path, locked=list(lock))
    return load_robot(path, gravity_in_base=arm.gravity_in_base, joint_names=arm.joint_names)


def _designed(specification: DesignSpecification, seconds: float) -> DesignResult:
    """Return the best of as many starts as the time allows."""
    end = time.monotonic() + seconds
    designer = TrajectoryDesigner(specification)
    best, start = designer.initial(0), 0
    while time.monotonic() < end:
        try:
            found = designer.design(start, lambda: time.monotonic() >= end)
        except (DesignStoppedError, InfeasibleError):  # the other starts are as good
            start += 1
            continue
        start += 1
        if found.quality.objective < best.quality.objective:
            best = found
    return best
