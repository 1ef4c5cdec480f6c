"""Design an excitation trajectory for the `excitation` node; needs no running ROS.

Usage: ros2 run aerarm_ros excitation_designer --out trajectory.yaml
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from aerarm_ros.ros.process.process_end import INTERRUPTED, USER_ERROR, StopSignals, print_error
from aerarm_ros.ros.process.ros_arguments import OneLineParser
from aerarm_ros.ros.programs.identifier_options import at_least_one, positive

NAME = 'excitation_designer'


def main(arguments: Sequence[str] | None = None) -> int:
    """Design a trajectory; return 0, 2 for an invalid input, or 130 if a signal stopped the run."""
    stops: list[bool] = []
    with StopSignals(lambda: stops.append(True)):
        # Imported here, because loading the libraries takes seconds, and Ctrl-C must already work
        # in this time.
        from aerarm_ros.excitation.settings import DesignStoppedError
        from aerarm_ros.ros.programs.design_run import DesignRun

        options = _parse(arguments)
        try:
            DesignRun(options, lambda: bool(stops)).run()
        except (ValueError, OSError) as error:
            print_error(NAME, error)
            stopped = isinstance(error, DesignStoppedError) and stops
            return INTERRUPTED if stopped else USER_ERROR
    return 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = OneLineParser(prog=NAME, description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--out', type=Path, default=Path('trajectory.yaml'),
        help='file for the trajectory (default: %(default)s)')  # fmt: skip
    add('--overwrite', action='store_true', help='overwrite existing files')
    add('--validation', action='store_true',
        help='also write a slower and a faster random trajectory, for validation')  # fmt: skip
    add('--condition-limit', type=float, default=26.0,
        help='largest condition number, equation (5.2) of the thesis (default: '
             '%(default)s)')  # fmt: skip
    add('--fundamental', type=positive, default=0.1,
        help='fundamental frequency f0 of the trajectory [Hz] (default: %(default)s)')  # fmt: skip
    add('--harmonics', type=int, default=5,
        help='number of harmonics N of the trajectory (default: %(default)s)')  # fmt: skip
    add('--duration', type=positive, default=20.0,
        help='duration of the motion at full speed, a multiple of the period 1/f0 [s] (default: '
             '%(default)s)')  # fmt: skip
    add('--amplitude', type=float, default=0.35,
        help='largest Fourier coefficient of the random initial trajectories [rad] (default: '
             '%(default)s)')  # fmt: skip
    add('--bias', type=float, nargs='+',
        help='joint angles at the centre of the motion [rad], one value per joint')  # fmt: skip
    add('--seed', type=int, default=1,
        help='seed of the random initial trajectories (default: %(default)s)')  # fmt: skip
    add('--starts', type=at_least_one, default=8,
        help='number of random initial trajectories that the search improves (default: '
             '%(default)s)')  # fmt: skip
    add('--workers', type=at_least_one, default=os.cpu_count() or 1,
        help='number of parallel processes (default: one per CPU)')  # fmt: skip
    add('--time-limit', type=positive, default=55.0,
        help='time limit of the search [s] (default: %(default)s)')  # fmt: skip
    add('--excitation-config', type=Path,
        help='YAML file with clearances, and with the fraction of each joint limit that the '
             'motion may use (default: the packaged file)')  # fmt: skip
    add('--config', type=Path,
        help='arm configuration with motors and gears (default: the packaged file)')  # fmt: skip
    add('--urdf', type=Path,
        help='URDF of another arm. Without --config, the limits come from this URDF and from '
             '--acceleration-limit')  # fmt: skip
    add('--locked', nargs='*', default=[],
        help='joints of --urdf that the model treats as fixed, for example fingers')  # fmt: skip
    add('--package-directory', type=Path, action='append', default=[],
        help='folder in which to search for meshes that the URDF names by package:// '
             'addresses')  # fmt: skip
    add('--acceleration-limit', type=float, nargs='+',
        help='largest joint acceleration [rad/s^2] without --config, one value or one per '
             'joint')  # fmt: skip
    return parser.parse_args(arguments)
