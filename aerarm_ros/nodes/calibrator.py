"""Calibrate an arm's geometry, or the poses of arm and IMU on a drone, from recordings.

The calibrator reads tables and bags of any serial arm and needs no running ROS. It writes
calibrated.urdf, calibration.yaml, arm.yaml, summary.json and report.html; with --mount it writes
drone.yaml, summary.json and report.html.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from aerarm_ros.ros.process.process_end import (
    USER_ERROR,
    print_error,
    run_offline,
    without_ros_arguments,
)
from aerarm_ros.ros.process.ros_arguments import OneLineParser
from aerarm_ros.ros.programs.identifier_options import (
    Option,
    fraction,
    pair,
    positive,
    table_parser,
)

_OPTIONS: tuple[Option, ...] = (
    ('--bag', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'FILE'},
        'recordings from which to calibrate: .csv tables, rosbag2 folders, .mcap, .db3 and .bag '
        'files'),
    ('--validation', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'FILE'},
        'recordings of the same setup for validation, which the calibration does not use'),
    ('--holdout', {'type': fraction, 'default': 0.0, 'metavar': 'SHARE'},
        'fraction of the postures of --bag, drawn at random, for validation instead of '
        'calibration (default: 0)'),
    ('--urdf', {'type': Path, 'metavar': 'FILE'}, 'URDF of the arm (default: the packaged arm)'),
    ('--config', {'type': Path, 'metavar': 'FILE'},
        'arm configuration, of which the calibrator writes a copy with the estimated joint '
        'offsets, for example config/aerarm.yaml (default: the packaged file, or no file if --urdf '
        'is given)'),
    ('--link', {'default': '', 'metavar': 'NAME'},
        'link to which the markers are attached (default: the link after the last recorded '
        'joint)'),
    ('--level', {'choices': ('auto', 'offsets', 'geometry'), 'default': 'auto'},
        'errors to estimate. offsets: joint offsets; geometry: also link geometry; auto (default): '
        'the level with the smaller cross-validation error'),
    ('--no-compliance', {'action': 'store_true'},
        'do not estimate the deflection of the joints under gravity'),
    ('--tolerance',
        {'nargs': 2, 'type': positive, 'default': [2.0, 10.0], 'metavar': ('LENGTH', 'ANGLE')},
        'expected errors of lengths [mm] and angles [mrad] in the URDF; with smaller values the '
        'estimates stay closer to the URDF (default: 2 10)'),
    ('--eye-in-hand', {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'names of recorded poses of a fixed object, measured by a camera on the arm'),
    ('--length-unit', {'choices': ('m', 'cm', 'mm'), 'default': ''},
        'unit of lengths in columns whose name states no unit (default: m)'),
    ('--degrees', {'action': 'store_true'},
        'read joint positions and the angles roll, pitch and yaw in degrees if the column name '
        'states no unit'),
    ('--ignore', {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'names of markers, poses or columns that the calibrator does not use'),
    ('--rename', {'nargs': '+', 'type': pair, 'default': [], 'metavar': 'COLUMN=JOINT'},
        "pairs of a joint's name in the recording (COLUMN) and its name in the URDF (JOINT)"),
    ('--lock', {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints that the recording omits, because their positions stayed at zero'),
    ('--gravity', {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        "gravity in the frame of the arm's base [m/s^2] (default: as in --config, otherwise 0 0 "
        '-9.81)'),
    ('--topic', {'default': '/joint_states', 'metavar': 'NAME'},
        'topic of the joint states in the bags (default: %(default)s)'),
    ('--sensors', {'nargs': '+', 'default': [], 'metavar': 'TOPIC'},
        'topics of markers and poses in the bags, of type PointStamped, PoseStamped, '
        'TransformStamped or TFMessage (default: all topics of these types that programs outside '
        'this suite publish)'),
    ('--frames', {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'child frames that the calibrator uses from TFMessage topics (default: all except the '
        'links of the URDF)'),
    ('--mount', {'action': 'store_true'},
        "estimate the poses of the arm's base and of the IMU on the drone, and write a drone "
        'file; needs a bag in which drone and arm move'),
    ('--drone', {'type': Path, 'metavar': 'FILE'},
        'drone file with the nominal poses for --mount (default: the packaged drone.yaml)'),
    ('--drone-pose', {'default': '/odometry', 'metavar': 'NAME'},
        "topic with the drone's pose for --mount, of type Odometry or PoseStamped (default: "
        '%(default)s)'),
    ('--imu', {'default': '/imu', 'metavar': 'NAME'},
        'topic of the IMU for --mount (default: %(default)s)'),
    ('--out', {'type': Path, 'metavar': 'DIR'},
        'folder for the results (default: output/calibration_DATE_TIME)'),
)  # fmt: skip


def calibrator_parser(name: str, description: str) -> OneLineParser:
    """Return the command-line parser of the calibrator."""
    return table_parser(name, description, _OPTIONS)


_NAME = 'calibrator'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the calibrator; return 0, or 2 for an invalid input."""
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
    from aerarm_ros.ros.programs.calibrator_mount import calibrate_on_drone
    from aerarm_ros.ros.programs.calibrator_run import calibrate_arm

    try:
        print((calibrate_on_drone if options.mount else calibrate_arm)(options))
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
        print_error(
            _NAME,
            f'the calculation failed ({error}): check that marker positions and joint states are '
            'plausible',
        )
        return USER_ERROR
    return 0
