"""Python function that designs an excitation trajectory."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.design_file import designed_file
from aerarm_ros.excitation.settings import DesignStoppedError, ExcitationError, InfeasibleError
from aerarm_ros.excitation.trajectory import RampedExcitation
from aerarm_ros.excitation.trajectory_designer import (
    DesignResult,
    DesignSpecification,
    TrajectoryDesigner,
)
from aerarm_ros.motion.signals import Array, JointReference
from aerarm_ros.pages.html_text import paragraph, table
from aerarm_ros.ros.programs.design_run import load_setup


class PlannedExcitation:
    """Result of `plan_excitation`: a feasible Fourier trajectory and its condition number.

    Parameters
    ----------
    periods : int
        Number of periods in the motion.
    """

    def __init__(
        self, specification: DesignSpecification, result: DesignResult, periods: int
    ) -> None:
        self.result = result
        self._specification = specification
        self._periods = periods
        ramp_time = specification.setup.config.ramp_time
        self._motion = RampedExcitation(result.trajectory, periods, ramp_time)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in order, from base to tool."""
        return self._specification.setup.limits.joint_names

    @property
    def condition_number(self) -> float:
        """Condition number of the regressor along the motion, equation (5.2) of the thesis."""
        return self.result.quality.condition_number

    @property
    def duration(self) -> float:
        """Duration of the motion from rest to rest [s]."""
        return self._motion.duration

    def sample(self, rate: float = 1000.0) -> tuple[Array, JointReference]:
        """Return samples of the complete motion, from rest to rest.

        Parameters
        ----------
        rate : float
            Sampling rate [Hz].

        Returns
        -------
        (M,) ndarray
            Time of each sample [s].
        JointReference
            `q`, `dq` and `ddq`, each (M, n).

        Raises
        ------
        ExcitationError
            If the rate is not positive.
        """
        if not (np.isfinite(rate) and rate > 0.0):
            raise ExcitationError(f'rate = {rate:g} must be a positive frequency [Hz]')
        time = np.arange(int(self.duration * rate) + 1) / rate
        return time, self._motion.evaluate(time)

    def summary(self) -> str:
        """Return a text with duration, condition number and the smallest margin to each limit."""
        return f'{self._headline()}\n{self.result.report.as_table()}'

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the trajectory to a file that the node `excitation` can play.

        Raises
        ------
        ExcitationError
            If the file cannot be written.
        """
        file = Path(path)
        designed_file(self._specification, self.result, self._periods).save(file)
        return file

    def _headline(self) -> str:
        series = self.result.trajectory
        return (
            f'{self.duration:g} s, {self._periods} periods of {series.f0:g} Hz with '
            f'{series.alpha.shape[1]} harmonics, condition number {self.condition_number:.1f} (5.2)'
        )

    def __repr__(self) -> str:
        """Return a short text with duration and condition number."""
        return f'<PlannedExcitation: {self._headline()}>'

    def _repr_html_(self) -> str:
        """Return an HTML table with the smallest margin to each limit, for a notebook."""
        rows = [
            [m.limit, m.subject, float(m.reached), float(m.allowed), m.unit]
            for m in self.result.report.worst_of_each()
        ]
        return paragraph(self._headline()) + table(
            ['limit', 'closest', 'reached', 'allowed', 'unit'], rows
        )


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
    """Design an excitation for the identification of an arm, within all limits of the arm.

    Parameters
    ----------
    urdf : path or Robot, optional
        Model of the arm; this package's arm by default.
    fundamental : float
        Fundamental frequency f0 [Hz].
    harmonics, periods : int
        Number N of harmonics, and number of periods in the motion.
    seconds : float
        Time for the optimization [s]; 0 returns the first feasible random motion.
    seed : int
        Seed of the random starts.
    config : path, optional
        File with motors and gears; not needed for this package's arm.
    room : path, optional
        Surroundings and used fractions of the limits, in the form of `config/excitation.yaml`. The
        default is `config/excitation.yaml` for this package's arm, and no surroundings for other
        arms.
    bias : (n,) sequence, optional
        Centre of the motion [rad].
    lock : sequence of str
        Joints of the URDF that do not move.
    package_directories : sequence of paths
        Directories in which `package://` meshes are searched.
    acceleration_limit : float or (n,) array_like
        Limits of the joint accelerations [rad/s^2], for an arm without a file of motors and gears.

    Raises
    ------
    ConfigError, DescriptionError, ExcitationError
        If an input is invalid, or no motion is feasible; the message states what to check.
    """
    if not (np.isfinite(seconds) and seconds >= 0.0):
        raise ExcitationError(
            f'seconds = {seconds:g} is not a valid optimization time: pass 0 or more seconds'
        )
    if periods < 1:
        raise ExcitationError(f'periods = {periods} is too small: pass at least 1')
    lock = [lock] if isinstance(lock, str) else list(lock)
    arm = Path(urdf) if isinstance(urdf, str | os.PathLike) else urdf
    if lock and (arm is None or isinstance(arm, Robot) or config is not None):
        raise ExcitationError(
            f'lock = {", ".join(lock)} is possible only if urdf is a path and config is not given: '
            'pass load_robot(urdf, locked=...) as urdf instead'
        )
    drives, surroundings = (None if file is None else Path(file) for file in (config, room))
    folders = tuple(Path(folder) for folder in package_directories)
    limit = acceleration_limit if np.isfinite(acceleration_limit).any() else None
    setup = load_setup(arm, drives, surroundings, bias, lock, folders, limit)
    specification = DesignSpecification(setup, fundamental, harmonics, seed=seed)
    return PlannedExcitation(specification, _designed(specification, seconds), periods)


def _designed(specification: DesignSpecification, seconds: float) -> DesignResult:
    """Optimize from random starts for `seconds` [s], and return the best design."""
    end = time.monotonic() + seconds
    designer = TrajectoryDesigner(specification)
    best, start = designer.initial(0), 0
    while time.monotonic() < end:
        try:
            found = designer.design(start, lambda: time.monotonic() >= end)
        except (DesignStoppedError, InfeasibleError):  # the other starts remain valid
            start += 1
            continue
        start += 1
        if specification.betters(found.quality, best.quality):
            best = found
    return best
