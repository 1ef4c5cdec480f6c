"""What the identifier can be asked for; imports nothing slow, so that --help is quick."""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

from aerarm_ros.ros.process.ros_arguments import OneLineParser


def _optional_path(text: str) -> Path | None:
    """Return a path, None for the empty text of an unset launch argument."""
    return Path(text) if text else None


# Option, what argparse needs to know, and help.
_OPTIONS: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        '--bag',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags to identify from; also .mcap, .db3, .csv and .npz files, and .bag of ROS 1',
    ),
    (
        '--validation',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags to predict',
    ),
    (
        '--payload',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags of the same arm carrying something: its mass, centre of mass and inertia',
    ),
    (
        '--model',
        {'type': _optional_path, 'metavar': 'FILE'},
        'estimate.yaml of the arm: only what --payload shows is identified, without --bag',
    ),
    (
        '--each',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'BAG'},
        'identify each bag by itself, into one table: bags, folders of them, a pattern in quotes, '
        'a .txt file with one path a line; the same --out goes on where it was ended',
    ),
    (
        '--workers',
        {'type': int, 'default': 0, 'metavar': 'N'},
        'processes for --each (default: one for each CPU)',
    ),
    (
        '--worker-memory',
        {'type': float, 'default': 4.0, 'metavar': 'GIB'},
        'memory of each process for --each; 0 for no limit (default: %(default)g)',
    ),
    (
        '--ray',
        {'default': '', 'metavar': 'ADDRESS'},
        "run --each on the Ray cluster of this address; 'local' starts one on this computer",
    ),
    (
        '--holdout',
        {'type': float, 'default': 0.0, 'metavar': 'SHARE'},
        'validate on this last share of each --bag',
    ),
    (
        '--urdf',
        {'type': _optional_path, 'metavar': 'FILE'},
        "URDF of the arm (default: this package's)",
    ),
    (
        '--config',
        {'type': _optional_path, 'metavar': 'FILE'},
        'motors and gears, as config/aerarm.yaml',
    ),
    (
        '--topic',
        {'default': '/joint_states', 'metavar': 'NAME'},
        'JointState topic (default: %(default)s)',
    ),
    (
        '--rate',
        {'type': float, 'metavar': 'HZ'},
        'of the rows of a .csv or .npz without a column of time',
    ),
    (
        '--degrees',
        {'action': 'store_true'},
        'positions and velocities of .csv and .npz are in degrees, where no unit is stated',
    ),
    (
        '--numbered-from',
        {'type': int, 'choices': (0, 1)},
        'number of the first joint in the columns of a .csv (default: recognized from the columns)',
    ),
    (
        '--bag-ratio',
        {'type': float, 'default': 100.0, 'metavar': 'N'},
        'a bag may become N times as large in memory as it is on disk (default: %(default)g)',
    ),
    (
        '--bag-part',
        {'type': float, 'default': 64.0, 'metavar': 'MB'},
        'a chunk or message of a bag may have so many MB (default: %(default)g)',
    ),
    (
        '--out',
        {'type': Path, 'metavar': 'DIR'},
        'result folder (default: output/identification_...)',
    ),
    (
        '--verify',
        {'type': Path, 'metavar': 'FILE'},
        'limits that the result must keep, as filtered: 2.0; the exit status is 1 if it does not',
    ),
    (
        '--compare',
        {'nargs': 2, 'type': Path, 'metavar': ('OLD', 'NEW')},
        'two results: which friction and inertia differ by more than their uncertainty; no bags',
    ),
    ('--truth', {'type': Path, 'metavar': 'FILE'}, 'true parameters of a simulated arm'),
    (
        '--tf-prefix',
        {'default': '', 'metavar': 'TEXT'},
        "what the bag's joints have before their names in the URDF, as left_",
    ),
    ('--rename', {'nargs': '+', 'default': [], 'metavar': 'BAG=URDF'}, "names of the bag's joints"),
    (
        '--lock',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the URDF that do not move',
    ),
    (
        '--ignore',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT'},
        'joints of the bag to leave out',
    ),
    (
        '--effort-gain',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT=GAIN'},
        'recorded effort to Nm, e.g. Nm/A',
    ),
    (
        '--effort-gain-std',
        {'type': float, 'metavar': 'SHARE'},
        'relative standard deviation of the gains, in that of a payload (default: 0.1 with '
        '--effort-gain, else 0); payload_estimator --known-mass calibrates them',
    ),
    (
        '--gravity',
        {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        'in the base frame [m/s^2]',
    ),
    (
        '--exact-gravity',
        {'action': 'store_true'},
        'the base stands as it is said to: look for no tilt of it',
    ),
    (
        '--exact-stamps',
        {'action': 'store_true'},
        'positions, velocities and efforts of a message are of one instant: look for no delays',
    ),
    ('--fundamental', {'type': float, 'metavar': 'HZ'}, 'f0 of a periodic motion (default: found)'),
    (
        '--harmonics',
        {'type': int, 'metavar': 'N'},
        'harmonics of a periodic motion (default: found)',
    ),
    (
        '--cutoff',
        {'type': float, 'metavar': 'HZ'},
        'low-pass on torque (default: what the data choose)',
    ),
    (
        '--filter',
        {'choices': ('auto', 'harmonics', 'butterworth'), 'default': 'auto'},
        'of the kinematics: rectangular windows at the harmonics of a periodic motion, zero-phase '
        'low-pass, or what the data choose (default)',
    ),
    (
        '--friction',
        {'default': 'auto', 'metavar': 'MODEL'},
        'auto (default), or one or several, joined by +, of coulomb, load, offset, creep, stribeck '
        'and asymmetric',
    ),
    (
        '--coupled',
        {'nargs': '+', 'default': [], 'metavar': 'JOINT=DRIVER'},
        "joints that feel another one's velocity and acceleration, besides those of --config",
    ),
    (
        '--rollouts',
        {'action': 'store_true'},
        'simulate every model over half seconds of what it is validated on',
    ),
    (
        '--total-mass',
        {'nargs': 2, 'type': float, 'metavar': ('MIN', 'MAX')},
        'of all moving links, from weighing [kg]',
    ),
    (
        '--bound-centres',
        {'action': 'store_true'},
        "keep each centre of mass in the box of the link's inertia in the URDF",
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
        'besides cad, cad_friction, ols and sdp: wls (default), huber, entropic, output_error, '
        'slsqp, annealing (the last two take seconds)',
    ),
)


# Those that tell of the arm and of what its bags are like.
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
    """Return what reads the command line of a program of that name.

    The options it returns also say when they were read, as `started`.
    """
    parser = OneLineParser(prog=name, description=description.splitlines()[0])
    _add_options(parser, [option for option, *_ in _OPTIONS])
    parser.set_defaults(started=time.localtime())
    return parser


def add_arm_options(parser: OneLineParser) -> None:
    """Let a program take what the identifier takes to describe the arm and its bags."""
    _add_options(parser, _OF_ARM)


def _add_options(parser: OneLineParser, wanted: Collection[str]) -> None:
    for option, details, text in _OPTIONS:
        if option in wanted:
            # A list given twice adds up: the second one is no slip of which nobody would hear.
            more: dict[str, Any] = {'action': 'extend'} if details.get('nargs') == '+' else {}
            parser.add_argument(option, help=text, **more, **details)
