"""Compare the controllers of section 5.4 of the thesis on a simulated arm.

The arm follows a trajectory with gravity compensation and with computed torque. Each controller
uses CAD or true parameters, and runs with or without disturbance observer. The base of the arm is
still, tilted or moving. The program prints a table of tracking errors and writes an HTML page.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import NoReturn

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup, RandomTrajectory
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.excitation.trajectory import RampedExcitation
from aerarm_ros.experiment.experiment_bench import (
    ExperimentBench,
    ExperimentCase,
    ExperimentReport,
    ExperimentRun,
    all_cases,
    run_all,
)
from aerarm_ros.ros.process.process_end import INTERRUPTED, StopSignals, print_error
from aerarm_ros.ros.process.ros_arguments import OneLineParser
from aerarm_ros.simulation.arm_plant import PlantParameters

NAME = 'experiment'
FUNDAMENTAL, HARMONICS = 0.1, 5


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all cases, write the HTML page of results, and return the exit status."""
    options = _parse(arguments)
    try:
        config, robot = load_arm_config(), load_robot()
        truth = PlantParameters.nominal(config, robot).perturbed(options.arm_seed)
        motion = _motion(config, robot, options)
        cases = _cases(options.only)
        options.out.mkdir(parents=True, exist_ok=True)  # an error here precedes the long runs
    except (ValueError, OSError) as error:
        print(f'{NAME}: {error}', file=sys.stderr)
        return 1
    bench, report = ExperimentBench(config, robot, truth, motion), ExperimentReport(robot)
    print(
        f'{len(cases)} simulations of {motion.duration:.0f} s each; random parameters of the '
        f'simulated arm, with seed {options.arm_seed}',
        flush=True,
    )
    try:
        with StopSignals(_interrupt):
            workers = min(len(cases), len(os.sched_getaffinity(0)))
            with closing(run_all(bench, cases, workers)) as runs:
                for index, run in enumerate(runs, start=1):
                    _print_run(report, run, f'{index}/{len(cases)}')
    except KeyboardInterrupt:
        print_error(NAME, 'interrupted, so the program wrote no page')
        return INTERRUPTED
    except RuntimeError as error:
        print(f'{NAME}: {error}', file=sys.stderr)
        return 1
    print('\n' + report.text())
    path = options.out / 'controllers.html'
    note = (
        f'The motion is a random trajectory with five harmonics of {FUNDAMENTAL} Hz (seed '
        f'{options.seed}). The simulated arm has random parameters (seed {options.arm_seed}). '
        '"True" means that the controller uses these parameters. RMS and max are errors during the '
        'periodic motion. "Final" is the error one second after the motion; dry friction leaves an '
        'offset unless the controller has integral action.'
    )
    try:
        report.write(path, note)
    except OSError as error:
        print_error(
            NAME,
            f'cannot write the page {path} ({error.strerror}): check permissions and free space',
        )
        return 1
    print(f'\nPage      {path}')
    return 0


def _interrupt() -> NoReturn:
    raise KeyboardInterrupt


def _cases(text: str) -> list[ExperimentCase]:
    cases = [case for case in all_cases() if text in case.name]
    if not cases:
        names = '; '.join(case.name for case in all_cases())
        raise ValueError(f'no case has a name that contains {text!r} (--only): choose from {names}')
    return cases


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = OneLineParser(prog=NAME, description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--out', type=Path, default=Path('output') / NAME,
        help='folder for the page of results (default: %(default)s)')  # fmt: skip
    parser.add_argument('--seed', type=int, default=1,
        help='seed of the random trajectory (default: %(default)s)')  # fmt: skip
    parser.add_argument(
        '--amplitude',
        type=float,
        default=0.15,
        help='largest Fourier coefficient of the trajectory [rad] (default: %(default)s)',
    )
    parser.add_argument(
        '--only', default='', metavar='TEXT', help='run only cases whose name contains TEXT'
    )
    parser.add_argument('--arm-seed', type=int, default=7,
        help="seed of the simulated arm's random parameters (default: %(default)s)")  # fmt: skip
    return parser.parse_args(arguments)


def _motion(config: ArmConfig, robot: Robot, options: argparse.Namespace) -> RampedExcitation:
    """Return a random trajectory within the limits of the arm."""
    settings = load_excitation_config()
    setup = ExcitationSetup.of_arm(robot, config, settings)
    candidates = RandomTrajectory(
        settings.bias_of(robot), settings.bias_spread, options.amplitude, FUNDAMENTAL, HARMONICS
    )
    trajectory, _ = candidates.draw_feasible(options.seed, setup.checker, settings.ramp_time)
    return RampedExcitation(trajectory, 1, settings.ramp_time)


def _print_run(report: ExperimentReport, run: ExperimentRun, progress: str) -> None:
    name, joints, _, _, tool, *_ = report.add(run)
    print(
        f'{progress:>6}  {name}: RMS error of joints {joints} mrad, of the tool {tool} mm',
        flush=True,
    )
