"""Calibrate an arm's geometry, its mount and the drone's IMU from recorded measurements.

The calibrator reads tables and bags of any serial arm and needs no running ROS. The calibrator
writes calibrated.urdf, calibration.yaml, arm.yaml, summary.json and report.html, or drone.yaml.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aerarm_ros.ros.process.process_end import (
    USER_ERROR,
    print_error,
    run_offline,
    without_ros_arguments,
)
from aerarm_ros.ros.process.ros_arguments import OneLineParser

_OPTIONS: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        '--bag',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'FILE'},
        'bags or tables to calibrate from: .csv, .npz, rosbag2 directory, .mcap, .db3 or .bag',
    ),
    (
        '--validation',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'FILE'},
        'bags or tables of the same setup for validation only',
    ),
    (
        '--holdout',
        {'type': float, 'default': 0.0, 'metavar': 'SHARE'},
        'fraction of the configurations of --bag for validation, drawn at random (default: 0)',
    ),
    ('--urdf', {'type': Path, 'metavar': 'FILE'}, 'URDF of the arm (default: packaged)'),
    (
        '--config',
        {'type': Path, 'metavar': 'FILE'},
        'configuration that receives the offsets, for example config/aerarm.yaml (default: '
        'packaged, without --urdf)',
    ),
    (
        '--link',
        {'default': '', 'metavar': 'NAME'},
        'link that carries the markers (default: the link after the last recorded joint)',
    ),
    (
        '--level',
        {'choices': ('auto', 'frames', 'offsets', 'geometry'), 'default': 'auto'},
        'errors to estimate: none, joint offsets, offsets and link geometry, or the choice of '
        'cross-validation (default)',
    ),
    (
        '--no-compliance',
        {'action': 'store_true'},
        'do not estimate deflection of the joints under gravity',
    ),
    ('--eccentricity', {'action': 'store_true'}, 'estimate the first harmonic of the gear errors'),
    (
        '--tolerance',
        {'nargs': 2, 'type': float, 'default': [2.0, 10.0], 'metavar': ('LENGTH', 'ANGLE')},
        'typical errors of lengths [mm] and angles [mrad] of the URDF; smaller values keep the '
        'estimates closer to the URDF (default: 2 10)',
    ),
    (
        '--base-known',
        {'action': 'store_true'},
        "markers are in the frame of the URDF's base link (default: unknown frame)",
    ),
    (
        '--eye-in-hand',
        {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'poses of a fixed object, measured by a camera on the arm',
    ),
    (
        '--length-unit',
        {'choices': ('m', 'cm', 'mm'), 'default': ''},
        'length unit of columns without a unit (default: m)',
    ),
    (
        '--degrees',
        {'action': 'store_true'},
        'joint positions and roll, pitch, yaw of poses are in degrees if the column states no unit',
    ),
    (
        '--ignore',
        {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'markers, poses or columns to ignore',
    ),
    (
        '--rename',
        {'nargs': '+', 'default': [], 'metavar': 'COLUMN=JOINT'},
        'joint name in the input and in the URDF',
    ),
    (
        '--lock',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the chain that stayed at zero and were not recorded',
    ),
    (
        '--gravity',
        {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        'gravity in the base frame [m/s^2] (default: as in the configuration, else 0 0 -9.81)',
    ),
    (
        '--topic',
        {'default': '/joint_states', 'metavar': 'NAME'},
        'JointState topic of bags (default: %(default)s)',
    ),
    (
        '--sensors',
        {'nargs': '+', 'default': [], 'metavar': 'TOPIC'},
        'PointStamped, PoseStamped, TransformStamped and TFMessage topics of bags (default: all '
        'except the outputs of this suite)',
    ),
    (
        '--frames',
        {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'child frames of TFMessages to use (default: all except links of the URDF)',
    ),
    (
        '--mount',
        {'action': 'store_true'},
        "estimate the poses of the arm's base and of the IMU on the drone, and write the drone "
        'file; needs a bag in which both move',
    ),
    (
        '--drone',
        {'type': Path, 'metavar': 'FILE'},
        'initial drone file for --mount (default: the packaged drone.yaml)',
    ),
    (
        '--drone-pose',
        {'default': '/odometry', 'metavar': 'NAME'},
        "topic of the drone's pose for --mount: Odometry or PoseStamped (default: %(default)s)",
    ),
    (
        '--imu',
        {'default': '/imu', 'metavar': 'NAME'},
        'topic of the IMU for --mount (default: %(default)s)',
    ),
    (
        '--out',
        {'type': Path, 'metavar': 'DIR'},
        'result folder (default: output/calibration_...)',
    ),
)


def calibrator_parser(name: str, description: str) -> OneLineParser:
    """Return the parser of a program; its options contain the start time as `started`."""
    parser = OneLineParser(prog=name, description=description.splitlines()[0])
    for option, details, text in _OPTIONS:
        more: dict[str, Any] = {'action': 'extend'} if details.get('nargs') == '+' else {}
        parser.add_argument(option, help=text, **more, **details)
    parser.set_defaults(started=time.localtime())
    return parser


_NAME = 'calibrator'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the calibrator; return 0, or 2 if the user must check an input."""
    parser = calibrator_parser(_NAME, __doc__)
    options = parser.parse_args(without_ros_arguments(arguments))
    if not options.bag:
        parser.error('the following arguments are required: --bag')
    return run_offline(_NAME, lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    # Imported here, so that --help is quick and Ctrl-C works from the start.
    import numpy as np

    from aerarm_msgs_py.storage.read_limits import BagError
    from aerarm_ros.calibration.observations import CalibrationError
    from aerarm_ros.description.config_reader import ConfigError, DescriptionError
    from aerarm_ros.identification.errors import IdentificationError
    from aerarm_ros.ros.programs.calibrator_mount import MountRun
    from aerarm_ros.ros.programs.calibrator_run import CalibratorRun

    try:
        print((MountRun if options.mount else CalibratorRun)(options).execute())
    except (
        BagError,
        CalibrationError,
        ConfigError,
        DescriptionError,
        IdentificationError,
        OSError,
    ) as error:
        print_error(_NAME, error)
        return USER_ERROR
    except np.linalg.LinAlgError as error:
        print_error(_NAME, f'{error}: check that positions and joint states are plausible')
        return USER_ERROR
    return 0


if __name__ == '__main__':
    sys.exit(main())
