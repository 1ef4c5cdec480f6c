"""Identifies an arm's dynamic parameters from recorded motion.

Reads JointState bags of any serial arm, needs no running ROS, and writes estimate.yaml,
identified.urdf, summary.json and report.html.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from aerarm_ros.ros.process.exit_status import INTERRUPTED, USER_ERROR
from aerarm_ros.ros.process.one_line_parser import OneLineParser

if TYPE_CHECKING:
    from aerarm_ros.ros.programs.identifier_run import IdentifierRun

_NAME = 'identifier'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the identifier; return 0, or 2 if the user has something to check."""
    # Before numpy is imported: the matrices are small, and more threads only fight over them.
    for variable in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(variable, '1')
    parser = _parser()
    options = parser.parse_args(_without_ros_arguments(arguments))
    if not options.bag and not options.model:
        parser.error('the following arguments are required: --bag, or --model and --payload')
    # SIGINT too: a shell that starts this in the background, or in a script, makes it ignored.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    try:
        return _run(options)
    except KeyboardInterrupt:
        print(f'{_NAME}: interrupted, nothing was written', file=sys.stderr)
        return INTERRUPTED


def _run(options: argparse.Namespace) -> int:
    # Imported here, so that --help is quick and an interrupt is answered from the start.
    import numpy as np

    from aerarm_msgs_py.bags.bag_error import BagError
    from aerarm_ros.description.config_error import ConfigError
    from aerarm_ros.description.description_error import DescriptionError
    from aerarm_ros.identification.recording.identification_error import IdentificationError
    from aerarm_ros.ros.programs.identifier_payload import PayloadRun
    from aerarm_ros.ros.programs.identifier_run import IdentifierRun

    try:
        run: IdentifierRun = (PayloadRun if options.model else IdentifierRun)(options)
        print(run.execute())
    except (BagError, ConfigError, DescriptionError, IdentificationError, OSError) as error:
        return _report(error)
    except np.linalg.LinAlgError as error:
        return _report(f'{error}: check that masses, inertias and joint states are plausible')
    return 0


def _report(error: object) -> int:
    print(f'{_NAME}: {" ".join(str(error).split())}', file=sys.stderr)
    return USER_ERROR


def _interrupt(number: int, frame: Any) -> NoReturn:
    raise KeyboardInterrupt


def _without_ros_arguments(arguments: Sequence[str] | None) -> list[str]:
    """Return the arguments without those that a launch file appends for ROS."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    while '--ros-args' in given:
        start = given.index('--ros-args')
        end = given.index('--', start) + 1 if '--' in given[start:] else len(given)
        del given[start:end]
    return given


def _optional_path(text: str) -> Path | None:
    """Return a path, None for the empty text of an unset launch argument."""
    return Path(text) if text else None


# Option, what argparse needs to know, and help.
_OPTIONS: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        '--bag',
        {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'bags to identify from',
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
        '--out',
        {'type': Path, 'metavar': 'DIR'},
        'result folder (default: output/identification_...)',
    ),
    ('--truth', {'type': Path, 'metavar': 'FILE'}, 'true parameters of a simulated arm'),
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
        '--gravity',
        {'nargs': 3, 'type': float, 'metavar': ('X', 'Y', 'Z')},
        'in the base frame [m/s^2]',
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
        'low-pass on torque (default: 10 times the motion)',
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
            'choices': ('cad', 'ols', 'wls', 'huber', 'slsqp', 'annealing', 'entropic', 'sdp'),
            'default': ['wls'],
            'metavar': 'NAME',
        },
        'besides cad, ols and sdp: wls (default), huber, entropic, slsqp, annealing (the last two '
        'take seconds)',
    ),
)


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog=_NAME, description=(__doc__ or '').splitlines()[0])
    for name, details, text in _OPTIONS:
        parser.add_argument(name, help=text, **details)
    parser.set_defaults(started=datetime.now())
    return parser


if __name__ == '__main__':
    sys.exit(main())
