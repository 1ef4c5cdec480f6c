"""Command-line options of the identifier; the module has no slow imports, so `--help` is fast."""

from __future__ import annotations

import argparse
import math
import time
from argparse import ArgumentTypeError
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from aerarm_ros.ros.process.ros_arguments import OneLineParser


def fraction(text: str) -> float:
    """Convert text to a fraction of at least 0 and below 1; raise ArgumentTypeError otherwise."""
    value = float(text)
    if not 0.0 <= value < 1.0:
        raise ArgumentTypeError(f'{text} is invalid: pass a fraction of at least 0 and below 1')
    return value


def positive(text: str) -> float:
    """Convert text to a positive finite number; raise ArgumentTypeError otherwise."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise ArgumentTypeError(f'{text} is invalid: pass a positive number')
    return value


def at_least_one(text: str) -> int:
    """Convert text to a positive whole number; raise ArgumentTypeError otherwise."""
    value = int(text)
    if value < 1:
        raise ArgumentTypeError(f'{text} is invalid: pass a positive whole number')
    return value


def pair(text: str) -> tuple[str, str]:
    """Split a text of the form LEFT=RIGHT; raise ArgumentTypeError for any other text."""
    left, equals, right = text.partition('=')
    if not (left and equals and right):
        raise ArgumentTypeError(f'{text} is invalid: write two names joined by =')
    return left, right


def gain(text: str) -> tuple[str, float]:
    """Split a text of the form JOINT=GAIN; raise ArgumentTypeError for any other text."""
    joint, number = pair(text)
    value = float(number)
    if not math.isfinite(value) or value == 0.0:
        raise ArgumentTypeError(f'{text} is invalid: pass a finite gain except zero')
    return joint, value


def optional_path(text: str) -> Path | None:
    """Convert text to a path; an empty string (a launch argument without a value) gives None."""
    return Path(text) if text else None


Option = tuple[str, dict[str, Any], str]
"""Name of an option, its keyword arguments for argparse, and its help text."""

_OPTIONS: tuple[Option, ...] = (
    ('--bag', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'recordings from which to identify the arm: rosbag2 folders, or .mcap, .db3, .csv, .npz '
        'and ROS 1 .bag files'),
    ('--validation', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'recordings for validation, which the identification does not use'),
    ('--payload', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'recordings of the same arm with a payload, from which the identifier estimates the '
        "payload's mass, centre of mass and inertia"),
    ('--model', {'type': optional_path, 'metavar': 'FILE'},
        'identified model of the arm, estimate.yaml; with this option the identifier estimates '
        'only the payload of --payload, and needs no --bag'),
    ('--holdout', {'type': fraction, 'default': 0.0, 'metavar': 'SHARE'},
        'fraction of each recording of --bag, taken from its end, for validation instead of '
        'identification'),
    ('--urdf', {'type': optional_path, 'metavar': 'FILE'},
        'URDF of the arm (default: the packaged arm)'),
    ('--config', {'type': optional_path, 'metavar': 'FILE'},
        'arm configuration with motors and gears, for example config/aerarm.yaml'),
    ('--topic', {'default': '/joint_states', 'metavar': 'NAME'},
        'topic of the joint states in the bags (default: %(default)s)'),
    ('--rate', {'type': float, 'metavar': 'HZ'},
        'sampling rate of .csv and .npz files without a time column [Hz]'),
    ('--degrees', {'action': 'store_true'},
        'read positions and velocities of .csv and .npz files in degrees if the column name '
        'states no unit'),
    ('--numbered-from', {'type': int, 'choices': (0, 1)},
        'number of the first joint, 0 or 1, in the column names of a .csv file (default: '
        'detected)'),
    ('--bag-ratio', {'type': float, 'default': 100.0, 'metavar': 'N'},
        'largest accepted ratio of decompressed size to file size of a bag (default: %(default)g)'),
    ('--bag-part', {'type': float, 'default': 64.0, 'metavar': 'MB'},
        'largest accepted chunk or message of a bag [MiB] (default: %(default)g)'),
    ('--out', {'type': Path, 'metavar': 'DIR'},
        'result folder (default: output/identification_DATE_TIME)'),
    ('--truth', {'type': Path, 'metavar': 'FILE'},
        'file with the true parameters of a simulated arm, for comparison with the estimates'),
    ('--tf-prefix', {'default': '', 'metavar': 'TEXT'},
        'prefix that the joint names have in the bag but not in the URDF, for example left_'),
    ('--rename', {'nargs': '+', 'type': pair, 'default': [], 'metavar': 'BAG=URDF'},
        'name of a joint in the bag, and its name in the URDF'),
    ('--lock', {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the URDF that did not move; the model treats them as fixed'),
    ('--ignore', {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints in the bag that do not belong to the arm'),
    ('--effort-gain', {'nargs': '+', 'type': gain, 'default': [], 'metavar': 'JOINT=GAIN'},
        'factor that converts the recorded effort of a joint to Nm, for example a torque '
        'constant in Nm/A'),
    ('--effort-gain-std', {'type': fraction, 'metavar': 'SHARE'},
        'relative standard deviation of the factors of --effort-gain, which affects the '
        'uncertainty of a payload (default: 0.1 with --effort-gain, otherwise 0); '
        'payload_estimator --known-mass calibrates these factors'),
    ('--gravity', {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        "gravity in the frame of the arm's base [m/s^2] (default: as in --config, otherwise 0 0 "
        '-9.81)'),
    ('--exact-gravity', {'action': 'store_true'},
        "use the given direction of gravity, and do not estimate a tilt of the arm's base"),
    ('--fundamental', {'type': float, 'metavar': 'HZ'},
        'fundamental frequency f0 of a periodic motion [Hz] (default: detected)'),
    ('--cutoff', {'type': float, 'metavar': 'HZ'},
        'cutoff frequency of the low-pass filter for the torque [Hz] (default: chosen by '
        'cross-validation)'),
    ('--friction', {'default': 'auto', 'metavar': 'MODEL'},
        'friction model: auto (default), or terms joined by +, for example coulomb+load. Terms '
        'are coulomb, load, offset, creep, stribeck, asymmetric and dahl (dry friction that '
        'builds up over 0.01 rad after a reversal)'),
    ('--coupled', {'nargs': '+', 'type': pair, 'default': [], 'metavar': 'JOINT=DRIVER'},
        'pairs of coupled drives, in addition to those of --config: the torque of JOINT depends '
        'on velocity and acceleration of DRIVER'),
    ('--total-mass', {'nargs': 2, 'type': float, 'metavar': ('MIN', 'MAX')},
        'smallest and largest possible total mass of the moving links [kg], for example from '
        'weighing'),
    ('--bound-centres', {'action': 'store_true'},
        'constrain the centre of mass of each link to the inside of a homogeneous box with the '
        "link's inertia in the URDF"),
    ('--solvers', {'nargs': '+', 'default': [], 'metavar': 'NAME'},
        'solvers in addition to cad, cad_friction, ols and sdp, which always run: wls (default), '
        'entropic, slsqp or annealing; slsqp and annealing take seconds'),
)  # fmt: skip


# Options about the arm and its bags.
_OF_ARM = (
    '--urdf', '--config', '--topic', '--rate', '--degrees', '--numbered-from', '--bag-ratio',
    '--bag-part', '--tf-prefix', '--rename', '--lock', '--ignore', '--effort-gain',
    '--effort-gain-std', '--gravity',
)  # fmt: skip


def table_parser(name: str, description: str, options: Iterable[Option]) -> OneLineParser:
    """Return a program's parser, which adds the program's start time as the option `started`."""
    parser = OneLineParser(prog=name, description=description.splitlines()[0])
    _add_options(parser, options)
    parser.set_defaults(started=time.localtime())
    return parser


def identifier_parser(name: str, description: str) -> OneLineParser:
    """Return the command-line parser of the identifier."""
    return table_parser(name, description, _OPTIONS)


def add_arm_options(parser: OneLineParser) -> None:
    """Add the identifier's options about the arm and its bags to a parser."""
    _add_options(parser, (option for option in _OPTIONS if option[0] in _OF_ARM))


def _add_options(parser: OneLineParser, options: Iterable[Option]) -> None:
    for name, details, text in options:
        # If the user gives a list option twice, both lists apply.
        more: dict[str, Any] = {'action': 'extend'} if details.get('nargs') == '+' else {}
        parser.add_argument(name, help=text, **more, **details)


def result_folder(options: argparse.Namespace, kind: str) -> Path:
    """Return the folder of `--out`, by default a folder named after the program's start time."""
    given: Path | None = options.out
    return given or Path('output') / time.strftime(f'{kind}_%Y%m%d_%H%M%S', options.started)
