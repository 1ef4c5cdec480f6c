"""`excitation_designer`: check the options, search for a trajectory, and write the files."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.design_file import designed_file
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.parallel_design import design_all
from aerarm_ros.excitation.settings import (
    DesignStoppedError,
    ExcitationConfig,
    ExcitationError,
    InfeasibleError,
    load_excitation_config,
)
from aerarm_ros.excitation.trajectory_designer import (
    DesignResult,
    DesignSpecification,
    TrajectoryDesigner,
)
from aerarm_ros.ros.process.process_end import ProgressLine


def whole_periods(duration: float, fundamental: float) -> int:
    """Return how many periods of the fundamental frequency [Hz] a duration [s] contains.

    Raises
    ------
    ExcitationError
        If the duration is not a whole number of periods.
    """
    periods = duration * fundamental
    whole = round(periods)
    if whole < 1 or abs(periods - whole) > 1e-6:
        near = [n / fundamental for n in (math.floor(periods), math.ceil(periods)) if n > 0]
        raise ExcitationError(
            f'--duration {duration:g} s is not a multiple of the period of '
            f'{1.0 / fundamental:g} s, and the filters of the identification need whole periods: '
            f'pass {" or ".join(f"{value:g} s" for value in near)}'
        )
    return whole


def load_setup(
    urdf: Path | Robot | None,
    config: Path | None,
    excitation_config: Path | None,
    bias: Sequence[float] | None = None,
    locked: Sequence[str] = (),
    package_directories: Sequence[Path] = (),
    acceleration_limit: npt.ArrayLike | None = None,
) -> ExcitationSetup:
    """Return model, limits and clearances of an arm, by default of the packaged arm.

    Parameters
    ----------
    config
        Configuration of the arm's drives, None for the packaged arm or an arm without known drives.
    bias
        Centre of the motion (n,) [rad], by default that of the file `excitation_config`.
    acceleration_limit
        Largest joint accelerations [rad/s^2] of an arm without known drives.

    Raises
    ------
    ValueError
        If a file cannot be used, or the arguments contradict each other.
    """
    settings = ExcitationConfig()
    if excitation_config or urdf is None:
        settings = load_excitation_config(excitation_config)
    if bias is not None and len(bias):
        settings = replace(settings, bias=tuple(float(value) for value in bias))
    if urdf is not None and config is None:
        robot = urdf if isinstance(urdf, Robot) else load_robot(urdf, locked=locked)
        limit = np.inf if acceleration_limit is None else acceleration_limit
        return ExcitationSetup.of_robot(robot, settings, package_directories, limit)
    if acceleration_limit is not None:
        raise ExcitationError(
            'acceleration_limit cannot be combined with the configuration of the drives (config), '
            'which contains this limit: remove one of them'
        )
    arm = load_arm_config(config)
    if isinstance(urdf, Robot):
        robot = urdf
    else:
        robot = load_robot(urdf, gravity_in_base=arm.gravity_in_base, joint_names=arm.joint_names)
    return ExcitationSetup.of_arm(robot, arm, settings, package_directories)


def excitation_setup(options: argparse.Namespace) -> ExcitationSetup:
    """Return model, limits and clearances for the options of the designer, see `load_setup`."""
    files = (options.urdf, options.config, options.excitation_config)
    folders, acceleration = options.package_directory, options.acceleration_limit
    return load_setup(*files, options.bias, options.locked, folders, acceleration)


NAME = 'excitation_designer'
# Factors of the fundamental frequency. Motions of other speeds reveal a model that is valid at one
# speed only.
VALIDATION = {'slow': 0.5, 'fast': 2.0}


class DesignRun:
    """Search for an excitation trajectory, and keep the best trajectory so far in the output file.

    Parameters
    ----------
    options
        Parsed arguments of the designer.
    interrupted
        Returns whether the user has stopped the search.

    Raises
    ------
    ValueError, OSError
        If a file, a number or the combination of limits cannot be used.
    """

    def __init__(self, options: argparse.Namespace, interrupted: Callable[[], bool]) -> None:
        self._options = options
        self._interrupted = interrupted
        self._periods = whole_periods(options.duration, options.fundamental)
        out: Path = options.out
        names = VALIDATION if options.validation else ()
        self._validation_paths = {
            name: out.with_name(f'{out.stem}_validation_{name}{out.suffix}') for name in names
        }
        self._require_writable()
        self._began = time.monotonic()
        self._finished = 0
        self._progress = ProgressLine(NAME)
        setup = excitation_setup(options)
        self._specification = DesignSpecification(
            setup,
            options.fundamental,
            options.harmonics,
            options.condition_limit,
            options.amplitude,
            options.seed,
        )
        self._designer = TrajectoryDesigner(self._specification)

    def run(self) -> None:
        """Search until all random starts are done, the time is over, or the user stops it."""
        try:
            random = self._designer.initial(0, self._is_over)
            validation = self._validation()
        except DesignStoppedError:
            raise DesignStoppedError(
                f'{self._why()} before the designer found a feasible trajectory, so it wrote no '
                'files: pass a larger --time-limit or a smaller --amplitude'
            ) from None
        self._print(
            f'{NAME}: random    {_figures(random)}; the search compares each result with this '
            'random trajectory'
        )
        # Only after all inputs have been checked may files be written.
        self._save(random, self._options.out, self._specification)
        for path, (specification, result) in validation.items():
            self._save(result, path, specification)
            self._print(
                f'{path}: validation trajectory with a fundamental frequency of '
                f'{specification.fundamental:g} Hz'
            )
        self._conclude(self._search(random), random)

    def _search(self, random: DesignResult) -> DesignResult:
        options, best = self._options, random
        for outcome in design_all(
            self._specification, options.starts, options.workers, self._watch
        ):
            self._finished += 1
            if isinstance(outcome, InfeasibleError):
                self._print(f'{NAME}: one random start was skipped: {outcome}')
                continue
            if self._specification.betters(outcome.quality, best.quality):
                best = outcome
                self._save(best, options.out, self._specification)
            self._report(outcome, best, random)
        if self._finished < options.starts or self._is_over():
            self._print(
                f'{NAME}: {self._why()}; the output file contains the best trajectory found until '
                'then'
            )
        return best

    def _conclude(self, best: DesignResult, random: DesignResult) -> None:
        self._print(
            f'{self._options.out}: smallest distance of the trajectory from each limit\n'
            f'{best.report.as_table()}'
        )
        if best is not random:
            reference = 'the random trajectory above'
            compared = best.quality.compared_with(random.quality, reference)
            self._print(f'{NAME}: expected {compared} (geometric mean)')
        for warning in self._warnings(best, random):
            self._print(f'{NAME}: warning: {warning}')

    def _warnings(self, best: DesignResult, random: DesignResult) -> list[str]:
        """Return warnings about the quality of the trajectory and about unchecked limits."""
        warnings = []
        if best is random:
            warnings.append(
                'the search found no trajectory better than the random one: try more starts or a '
                'larger --time-limit'
            )
        condition, limit = best.quality.condition_number, self._specification.condition_limit
        if condition > limit:
            warnings.append(
                f'the condition number {condition:.1f} (thesis, 5.2) exceeds its limit of '
                f'{limit:g} (--condition-limit); the binding limit is {best.report.binding}. Try '
                'more starts, a larger --time-limit, more harmonics, or a wider binding limit'
            )
        limits = self._specification.setup.limits
        unknown = [
            text
            for text, values in (
                ('acceleration (--acceleration-limit)', limits.acceleration),
                ('torque (URDF)', limits.effort),
                ('motor current (--config)', limits.current),
            )
            if not np.isfinite(values).any()
        ]
        if unknown:
            warnings.append(
                f'the limit of {", ".join(unknown)} is unknown, so the designer did not check it: '
                'specify the limit if the arm has such a limit'
            )
        return warnings

    def _validation(self) -> dict[Path, tuple[DesignSpecification, DesignResult]]:
        """Return a slow and a fast random trajectory for validation, with output files as keys."""
        results = {}
        highest = self._specification.setup.config.highest_frequency
        for name, path in self._validation_paths.items():
            fundamental = VALIDATION[name] * self._options.fundamental
            # Elastic vibrations of the arm limit the highest frequency of a motion.
            harmonics = min(self._options.harmonics, int(highest / fundamental + 1e-9))
            try:
                specification = replace(
                    self._specification,
                    fundamental=fundamental,
                    harmonics=max(1, harmonics),
                    seed=self._specification.seed + 1_000_000,
                )
                result = TrajectoryDesigner(specification).initial(0, self._is_over)
            except InfeasibleError as error:
                raise InfeasibleError(f'{name} validation trajectory: {error}') from None
            results[path] = specification, result
        return results

    def _require_writable(self) -> None:
        """Raise ExcitationError before the long search if an output file cannot be written."""
        options = self._options
        for path in (options.out, *self._validation_paths.values()):
            if path.is_dir():
                raise ExcitationError(f'{path} is a folder: pass the name of a file')
            if path.is_file() and not options.overwrite:
                raise ExcitationError(
                    f'{path} already exists: name another file with --out, or pass --overwrite'
                )
            if not os.access(path.parent, os.W_OK):
                raise ExcitationError(
                    f'{path} cannot be written: check the folder and its permissions'
                )

    def _save(self, result: DesignResult, path: Path, specification: DesignSpecification) -> None:
        # As many periods as the requested duration has, but at least one.
        ratio = specification.fundamental / self._options.fundamental
        designed_file(specification, result, max(1, round(self._periods * ratio))).save(path)

    def _report(self, result: DesignResult, best: DesignResult, random: DesignResult) -> None:
        compared = result.quality.compared_with(random.quality, 'the random trajectory')
        leader = 'random' if best is random else f'start {best.start}'
        remark = f' ({result.remark})' if result.remark else ''
        self._print(
            f'{NAME}: start {result.start:<3} {_figures(result)}, {compared}; best so far: '
            f'{leader}{remark}'
        )

    def _print(self, text: str) -> None:
        self._progress.close()
        print(text, flush=True)

    def _watch(self) -> bool:
        """Print the progress if the output is a terminal; return whether the search is over."""
        if sys.stdout.isatty() and self._progress.due(time.monotonic_ns()):
            self._progress.show(
                f'{self._seconds():4.1f} of {self._options.time_limit:g} s, '
                f'{self._finished} of {self._options.starts} starts done'
            )
        return self._is_over()

    def _is_over(self) -> bool:
        return self._interrupted() or self._seconds() > self._options.time_limit

    def _why(self) -> str:
        over = f'the time limit of {self._options.time_limit:g} s was reached'
        return 'the user stopped the search' if self._interrupted() else over

    def _seconds(self) -> float:
        return time.monotonic() - self._began


def _figures(result: DesignResult) -> str:
    quality = result.quality
    return (
        f'condition number {quality.condition_number:6.1f} (thesis, 5.2), '
        f'{quality.scaled_condition_number:6.1f} after scaling, {result.seconds:4.1f} s'
    )
