"""Designs an excitation trajectory that `excitation` plays; needs no running ROS.

Usage: ros2 run aerarm_ros excitation_designer --out trajectory.yaml --preview trajectory.html
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.design_specification import BOTH, OBJECTIVES, DesignSpecification
from aerarm_ros.excitation.excitation_config import ExcitationConfig, load_excitation_config
from aerarm_ros.excitation.excitation_error import ExcitationError, InfeasibleError
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.parallel_design import design_all
from aerarm_ros.excitation.preview import Preview
from aerarm_ros.excitation.trajectory_designer import DesignResult, TrajectoryDesigner
from aerarm_ros.excitation.trajectory_file import TrajectoryFile, describe_margins
from aerarm_ros.nodes.stop_signals import StopSignals

NAME = 'excitation_designer'
# Other frequencies for validation: a model that holds only at one speed is found out.
VALIDATION = {'slow': 0.5, 'fast': 2.0}


def main(arguments: Sequence[str] | None = None) -> int:
    """Design, and return 0 if a trajectory was written."""
    options = _parse(arguments)
    try:
        DesignRun(options).run()
    except (ValueError, OSError) as error:
        print(f'{NAME}: {" ".join(str(error).split())}', file=sys.stderr)
        return 1
    return 0


class DesignRun:
    """One run of the program: keeps the best trajectory so far in the file asked for.

    Parameters
    ----------
    options : the command line.

    Raises
    ------
    ValueError, OSError
        If a file, a number or the combination of limits cannot be used.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._periods = _whole_periods(options.duration, options.fundamental)
        if options.starts < 1 or options.workers < 1:
            raise ExcitationError('at least one start and one worker are needed')
        self._specification = DesignSpecification(
            _setup(options),
            options.fundamental,
            options.harmonics,
            options.objective,
            options.condition_limit,
            options.amplitude,
            seed=options.seed,
        )
        self._designer = TrajectoryDesigner(self._specification)
        self._deadline = time.monotonic() + options.time_limit
        self._interrupted = False

    def run(self) -> None:
        """Design until all starts are done, the time is up or the user has had enough."""
        with StopSignals(self._on_stop):
            random = best = self._designer.initial(0)
            self._report('random', random, best)
            self._save(best, self._options.out, self._specification)
            for outcome in design_all(
                self._specification, self._options.starts, self._options.workers, self._is_over
            ):
                if isinstance(outcome, InfeasibleError):
                    print(f'{NAME}: a start was given up: {outcome}', flush=True)
                    continue
                if outcome.quality.objective < best.quality.objective:
                    best = outcome
                    self._save(best, self._options.out, self._specification)
                self._report(f'start {outcome.start}', outcome, best)
        if self._is_over():
            why = 'stopped' if self._interrupted else f'{self._options.time_limit:g} s are over'
            print(f'{NAME}: {why}; the best so far is kept', flush=True)
        self._write_companions(best, random)

    def _write_companions(self, best: DesignResult, random: DesignResult) -> None:
        print(f'{self._options.out}: closest to each limit\n{best.report.as_table()}', flush=True)
        if self._options.preview:
            Preview(self._designer, best, random).write(self._options.preview)
            print(f'{self._options.preview}: preview', flush=True)
        if self._options.validation:
            self._write_validation()

    def _write_validation(self) -> None:
        """Write a slower and a faster random trajectory with coefficients of their own."""
        for name, factor in VALIDATION.items():
            specification = replace(
                self._specification,
                fundamental=factor * self._options.fundamental,
                seed=self._specification.seed + 1_000_000,
            )
            out = self._options.out
            path = out.with_name(f'{out.stem}_validation_{name}{out.suffix}')
            result = TrajectoryDesigner(specification).initial(0)
            self._save(result, path, specification)
            print(f'{path}: {specification.fundamental:g} Hz', flush=True)

    def _save(self, result: DesignResult, path: Path, specification: DesignSpecification) -> None:
        quality = result.quality
        made_with: dict[str, Any] = {
            'objective': specification.objective,
            'seed': specification.seed,
            'start': result.start,
            'periods': max(
                1, round(self._periods * specification.fundamental / self._options.fundamental)
            ),
            'condition_number': round(quality.condition_number, 3),
            'scaled_condition_number': round(quality.scaled_condition_number, 3),
            'log_deviation': round(quality.log_deviation, 5),
            'margins': describe_margins(result.report),
        }
        names = specification.setup.limits.joint_names
        TrajectoryFile(result.trajectory, names, made_with).save(path)

    def _report(self, what: str, result: DesignResult, best: DesignResult) -> None:
        quality = result.quality
        print(
            f'{NAME}: {what:<9} condition {quality.condition_number:6.1f} (5.2), '
            f'{quality.scaled_condition_number:6.1f} scaled, deviations '
            f'e^{quality.log_deviation:.2f}, {result.seconds:4.1f} s; best so far '
            f'{best.quality.condition_number:.1f}, e^{best.quality.log_deviation:.2f}',
            flush=True,
        )

    def _is_over(self) -> bool:
        return self._interrupted or time.monotonic() > self._deadline

    def _on_stop(self) -> None:
        self._interrupted = True


def _whole_periods(duration: float, fundamental: float) -> int:
    """Return how many periods the duration [s] holds; raises if not a whole number."""
    if not (fundamental > 0.0 and duration > 0.0):
        raise ExcitationError('fundamental and duration must be positive')
    periods = duration * fundamental
    if round(periods) < 1 or abs(periods - round(periods)) > 1e-6:
        raise ExcitationError(
            f'the duration ({duration:g} s) is no multiple of the period '
            f'({1.0 / fundamental:g} s): a part of a period spoils the filtering'
        )
    return round(periods)


def _setup(options: argparse.Namespace) -> ExcitationSetup:
    """Return the packaged arm, or another one from its URDF with or without a drive train."""
    other = options.urdf is not None
    if options.excitation_config or not other:
        config = load_excitation_config(options.excitation_config)
    else:
        config = ExcitationConfig()
    if options.bias:
        config = replace(config, bias=tuple(options.bias))
    if options.config or not other:
        arm = load_arm_config(options.config)
        robot = load_robot(
            options.urdf, gravity_in_base=arm.gravity_in_base, joint_names=arm.joint_names
        )
        return ExcitationSetup.of_arm(robot, arm, config)
    robot = load_robot(options.urdf, locked=options.locked)
    return ExcitationSetup.of_robot(robot, config, options.package_directory)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=NAME, description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--out', type=Path, default=Path('trajectory.yaml'), help='file (default: %(default)s)')
    add('--preview', type=Path, help='HTML page with plots, workspace and animation')
    add('--validation', action='store_true', help='also write a slower and a faster trajectory')
    objectives = '; '.join(f'{key}: {text}' for key, text in OBJECTIVES.items())
    add('--objective', choices=list(OBJECTIVES), default=BOTH, help=objectives)
    add('--condition-limit', type=float, default=26.0, help=f'for {BOTH} (default: %(default)s)')
    add('--fundamental', type=float, default=0.1, help='f0 [Hz] (default: %(default)s)')
    add('--harmonics', type=int, default=5, help='N (default: %(default)s)')
    add('--duration', type=float, default=20.0, help='whole periods [s] (default: %(default)s)')
    add('--amplitude', type=float, default=0.35, help='of random starts [rad]')
    add('--bias', type=float, nargs='+', help='centre of the motion [rad], a joint each')
    add('--seed', type=int, default=1, help='of the random starts (default: %(default)s)')
    add('--starts', type=int, default=8, help='random starts (default: %(default)s)')
    add('--workers', type=int, default=os.cpu_count() or 1, help='processes')
    add('--time-limit', type=float, default=55.0, help='[s] (default: %(default)s)')
    add('--urdf', type=Path, help='another arm; its limits alone count without --config')
    add('--locked', nargs='*', default=[], help='joints of --urdf that do not move (fingers)')
    add('--package-directory', type=Path, action='append', default=[], help='for package:// meshes')
    add('--config', type=Path, help='drive train (default: the packaged arm)')
    add('--excitation-config', type=Path, help='surroundings and usable shares of the limits')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
