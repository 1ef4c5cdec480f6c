"""The calibrator's command line; it imports no slow library, so that --help is quick."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

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
