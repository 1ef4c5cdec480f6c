"""Options of the identifier; this module imports no slow library, so that --help is quick."""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

from aerarm_ros.ros.process.ros_arguments import OneLineParser


def _optional_path(text: str) -> Path | None:
    """Convert text to a path; return None for the empty text of an unset launch argument."""
    return Path(text) if text else None


# Option, arguments for argparse, and help.
_OPTIONS: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        '--bag',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags for identification; also .mcap, .db3, .csv and .npz files, and .bag of ROS 1',
    ),
    (
        '--validation',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags for validation',
    ),
    (
        '--payload',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags of the same arm with a payload: estimate its mass, centre of mass and inertia',
    ),
    (
        '--model',
        {'type': _optional_path, 'metavar': 'FILE'},
        'estimate.yaml of the arm: estimate only the payload of --payload, without --bag',
    ),
    (
        '--each',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'BAG'},
        'identify each bag separately and write one table. Pass bags, folders, a quoted pattern, '
        'or a .txt file with one path per line; repeat with the same --out to continue an '
        'interrupted run',
    ),
    (
        '--workers',
        {'type': int, 'default': 0, 'metavar': 'N'},
        'number of processes for --each (default: one per CPU)',
    ),
    (
        '--worker-memory',
        {'type': float, 'default': 4.0, 'metavar': 'GIB'},
        'memory limit per process for --each [GB]; 0 for none (default: %(default)g)',
    ),
    (
        '--ray',
        {'default': '', 'metavar': 'ADDRESS'},
        "run --each on the Ray cluster at this address; 'local' starts one on this computer",
    ),
    (
        '--holdout',
        {'type': float, 'default': 0.0, 'metavar': 'SHARE'},
        'fraction at the end of each --bag to use for validation',
    ),
    (
        '--urdf',
        {'type': _optional_path, 'metavar': 'FILE'},
        'URDF of the arm (default: packaged)',
    ),
    (
        '--config',
        {'type': _optional_path, 'metavar': 'FILE'},
        'configuration with motors and gears, for example config/aerarm.yaml',
    ),
    (
        '--topic',
        {'default': '/joint_states', 'metavar': 'NAME'},
        'JointState topic (default: %(default)s)',
    ),
    (
        '--rate',
        {'type': float, 'metavar': 'HZ'},
        'sampling rate of a .csv or .npz without a time column',
    ),
    (
        '--degrees',
        {'action': 'store_true'},
        'positions and velocities without a unit in .csv and .npz are in degrees',
    ),
    (
        '--numbered-from',
        {'type': int, 'choices': (0, 1)},
        'number of the first joint in the columns of a .csv (default: detected)',
    ),
    (
        '--bag-ratio',
        {'type': float, 'default': 100.0, 'metavar': 'N'},
        'largest ratio of memory to file size of a bag (default: %(default)g)',
    ),
    (
        '--bag-part',
        {'type': float, 'default': 64.0, 'metavar': 'MB'},
        'largest chunk or message of a bag [MB] (default: %(default)g)',
    ),
    (
        '--out',
        {'type': Path, 'metavar': 'DIR'},
        'result folder (default: output/identification_...)',
    ),
    (
        '--verify',
        {'type': Path, 'metavar': 'FILE'},
        'limits of the filtered validation error in percent, for example 2.0; exit status 1 if '
        'exceeded',
    ),
    (
        '--compare',
        {'nargs': 2, 'type': Path, 'metavar': ('OLD', 'NEW')},
        'two results to compare; prints friction and inertia that differ by more than their '
        'uncertainty. No bags',
    ),
    (
        '--truth',
        {'type': Path, 'metavar': 'FILE'},
        ('file with the true parameters of a simulated arm'),
    ),
    (
        '--tf-prefix',
        {'default': '', 'metavar': 'TEXT'},
        "prefix of the bag's joint names relative to the URDF, for example left_",
    ),
    (
        '--rename',
        {'nargs': '+', 'default': [], 'metavar': 'BAG=URDF'},
        'joint name in the bag and in the URDF',
    ),
    (
        '--lock',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the URDF to lock',
    ),
    (
        '--ignore',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the bag to ignore',
    ),
    (
        '--effort-gain',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT=GAIN'},
        'scale from recorded effort to Nm, for example a torque constant in Nm/A',
    ),
    (
        '--effort-gain-std',
        {'type': float, 'metavar': 'SHARE'},
        'relative standard deviation of the effort gains, for the uncertainty of a payload '
        '(default: 0.1 with --effort-gain, else 0); payload_estimator --known-mass calibrates '
        'the gains',
    ),
    (
        '--gravity',
        {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        'gravity in the base frame [m/s^2]',
    ),
    (
        '--exact-gravity',
        {'action': 'store_true'},
        'assume the stated gravity: do not estimate a tilt of the base',
    ),
    (
        '--exact-stamps',
        {'action': 'store_true'},
        'positions, velocities and efforts of a message have the same time: do not estimate delays',
    ),
    (
        '--fundamental',
        {'type': float, 'metavar': 'HZ'},
        'fundamental frequency f0 of a periodic motion (default: detected)',
    ),
    (
        '--harmonics',
        {'type': int, 'metavar': 'N'},
        'number of harmonics of a periodic motion (default: detected)',
    ),
    (
        '--cutoff',
        {'type': float, 'metavar': 'HZ'},
        'cutoff frequency of the torque low-pass (default: chosen by cross-validation)',
    ),
    (
        '--filter',
        {'choices': ('auto', 'harmonics', 'butterworth'), 'default': 'auto'},
        'filter of positions, velocities and accelerations: rectangular windows at the harmonics '
        'of a periodic motion, zero-phase low-pass, or chosen by cross-validation (default)',
    ),
    (
        '--friction',
        {'default': 'auto', 'metavar': 'MODEL'},
        'friction model: auto (default), or one or several of coulomb, load, offset, creep, '
        'stribeck, dahl (dry friction builds up over 0.01 rad after a reversal) and asymmetric, '
        'joined by +',
    ),
    (
        '--coupled',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT=DRIVER'},
        'joints whose torque depends on velocity and acceleration of another joint, the driver, '
        'in addition to the pairs of --config',
    ),
    (
        '--rollouts',
        {'action': 'store_true'},
        'also simulate every model over half-second windows of the validation data',
    ),
    (
        '--total-mass',
        {'nargs': 2, 'type': float, 'metavar': ('MIN', 'MAX')},
        'total mass of all moving links, from weighing [kg]',
    ),
    (
        '--bound-centres',
        {'action': 'store_true'},
        'keep each centre of mass within the inertia box of its link in the URDF',
    ),
    (
        '--solvers',
        {
            'nargs': '+',
            'choices': (
                *('cad', 'cad_friction', 'ols', 'wls', 'huber', 'slsqp', 'annealing', 'entropic'),
                *('sdp', 'output_error'),
            ),
            'default': [],
            'metavar': 'NAME',
        },
        'additional solvers: wls (default), huber, entropic, output_error, slsqp, annealing (the '
        'last two take seconds); cad, cad_friction, ols and sdp always run',
    ),
)


# Options about the arm and its bags.
_OF_ARM = (
    *(
        '--urdf',
        '--config',
        '--topic',
        '--rate',
        '--degrees',
        '--numbered-from',
        '--bag-ratio',
        '--bag-part',
    ),
    *(
        '--tf-prefix',
        '--rename',
        '--lock',
        '--ignore',
        '--effort-gain',
        '--effort-gain-std',
        '--gravity',
    ),
)


def identifier_parser(name: str, description: str) -> OneLineParser:
    """Return the command-line parser of a program.

    The parsed options contain the start time as `started`.
    """
    parser = OneLineParser(prog=name, description=description.splitlines()[0])
    _add_options(parser, [option for option, *_ in _OPTIONS])
    parser.set_defaults(started=time.localtime())
    return parser


def add_arm_options(parser: OneLineParser) -> None:
    """Add the identifier's options about the arm and its bags to a parser."""
    _add_options(parser, _OF_ARM)


def _add_options(parser: OneLineParser, wanted: Collection[str]) -> None:
    for option, details, text in _OPTIONS:
        if option in wanted:
            # A list option that is given twice adds up instead of replacing the first list
            # silently.
            more: dict[str, Any] = {'action': 'extend'} if details.get('nargs') == '+' else {}
            parser.add_argument(option, help=text, **more, **details)
