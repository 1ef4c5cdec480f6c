"""The command line of the calibrator; imports nothing slow, so that --help is quick."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from aerarm_ros.ros.process.ros_arguments import OneLineParser

_OPTIONS: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        '--bag',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'FILE'},
        'postures to calibrate from: .csv, .npz, rosbag2 directory, .mcap, .db3 or .bag',
    ),
    (
        '--validation',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'FILE'},
        'other postures of the same setup: only their error is computed',
    ),
    (
        '--holdout',
        {'type': float, 'default': 0.0, 'metavar': 'SHARE'},
        'share of the postures of --bag to hold out, drawn at random (default: 0)',
    ),
    ('--urdf', {'type': Path, 'metavar': 'FILE'}, "URDF of the arm (default: this package's)"),
    (
        '--config',
        {'type': Path, 'metavar': 'FILE'},
        'configuration that gets the offsets, as config/aerarm.yaml (default: the packaged one, '
        'without --urdf)',
    ),
    (
        '--link',
        {'default': '', 'metavar': 'NAME'},
        'link that carries the markers (default: the one behind the last recorded joint)',
    ),
    (
        '--level',
        {'choices': ('auto', 'frames', 'offsets', 'geometry'), 'default': 'auto'},
        'errors to estimate: none, joint offsets, link geometry as well, or what cross-validation '
        'prefers (default)',
    ),
    (
        '--no-compliance',
        {'action': 'store_true'},
        'do not try deflection of the joints under gravity',
    ),
    ('--eccentricity', {'action': 'store_true'}, 'try the first harmonic of the gears'),
    (
        '--base-known',
        {'action': 'store_true'},
        "markers are measured in the frame of the URDF's base link (default: unknown frame)",
    ),
    (
        '--eye-in-hand',
        {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'poses that a camera on the arm saw of something fixed',
    ),
    (
        '--length-unit',
        {'choices': ('m', 'cm', 'mm'), 'default': ''},
        'of columns that state none (default: m)',
    ),
    (
        '--degrees',
        {'action': 'store_true'},
        'joint positions are in degrees, where no unit is stated',
    ),
    (
        '--ignore',
        {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'markers, poses or columns to leave out',
    ),
    (
        '--rename',
        {'nargs': '+', 'default': [], 'metavar': 'COLUMN=JOINT'},
        'names of joints in the input and in the URDF',
    ),
    (
        '--lock',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the chain that stood at zero',
    ),
    (
        '--gravity',
        {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        'in the base frame [m/s^2] (default: of the configuration, else 0 0 -9.81)',
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
        'that are no output of this suite)',
    ),
    (
        '--frames',
        {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'child frames of TFMessages to use (default: all)',
    ),
    (
        '--mount',
        {'action': 'store_true'},
        "estimate the pose of the arm's base and of the IMU on the drone, from a bag in which both "
        'move, and write the drone file',
    ),
    (
        '--drone',
        {'type': Path, 'metavar': 'FILE'},
        'drone file that --mount starts from (default: the packaged drone.yaml)',
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
    """Return the parser of a program of that name; its options have the time, as `started`."""
    parser = OneLineParser(prog=name, description=description.splitlines()[0])
    for option, details, text in _OPTIONS:
        more: dict[str, Any] = {'action': 'extend'} if details.get('nargs') == '+' else {}
        parser.add_argument(option, help=text, **more, **details)
    parser.set_defaults(started=time.localtime())
    return parser
