"""Send one request to the bridge or a controller and print the result.

Usage: ros2 run aerarm_ros arm home --wait ready
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import NoReturn

from aerarm_ros.hardware.bridge_modes import ACTIONS, BRIDGES, MODES
from aerarm_ros.hardware.emulation.fault_injection import FAULTS, FORM
from aerarm_ros.motion.signals import REACTIONS
from aerarm_ros.ros.process.process_end import USER_ERROR, print_error, without_ros_arguments
from aerarm_ros.ros.process.ros_arguments import complete

NAME = 'arm'
_FAKE = 'fake_hardware'
_MEANING = {
    'enable': (
        'switch the motors on: they align first (THE ARM MOVES), then the bridge holds the arm'
    ),
    'hold': 'hold a damped arm in place, or hold a tracking arm once its controller stops',
    'disable': 'switch the motors off, so that the arm sinks',
    'clear_fault': 'clear a fault after its cause is removed',
    'home': (
        'turn the joints slowly to the index pulses of the encoders, from the home '
        'configuration: THE ARM MOVES'
    ),
    'e_stop': 'damp the arm at once, until clear_fault',
    'put_back': f'{_FAKE} with motors off: reset the arm to its initial configuration',
}
# Bridges that receive a request without a bridge's name.
_WHO = {
    'e_stop': 'all bridges of this namespace, or all bridges if it has none',
    'disable': 'every bridge of this namespace, of any name',
    'put_back': _FAKE,
}
# Commands that run another executable: its name, the parameter to set, and the parameter's
# meaning.
_PROGRAMS = {
    'play': (
        'excitation',
        'trajectory',
        'FILE',
        'play a trajectory file once the arm is ready',
    ),
    'record': (
        'recorder',
        'bag',
        'NAME',
        'record a bag with the given name, until Ctrl-C; on the ground, record it on the drone and '
        'fetch it afterwards',
    ),
}
_FETCH = 'fetch a bag that the drone recorded for the ground; resume after an interruption'
_HOME = (
    'home the arm first if an encoder zero is unknown; the arm must be in its home configuration'
)
_CALIBRATE = (
    'move the arm through calibration configurations and record at rest in each: THE ARM MOVES'
)
_INIT = 'write a first configuration of an arm from its URDF'
_COMMISSION = 'guide through the first power-on, joint by joint: THE ARM MOVES after a confirmation'
_TIMEOUT = 20.0  # [s]
# Twice the longest time in which a new node discovers a bridge.
_STOP_TIMEOUT = 8.0  # [s]


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog=NAME,
        description='Send one request to the bridge or another node and print the result.',
        epilog=(
            f'{NAME} COMMAND --help describes a command. Examples: {NAME} home --wait ready; '
            f'{NAME} enable --wait ready; {NAME} go 0 1.57 0 0; {NAME} set computed_torque kp '
            "'[900.0]'"
        ),
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    def add(name: str, meaning: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=meaning, description=meaning)
        # A stop request must report a missing bridge sooner.
        timeout = _STOP_TIMEOUT if name == 'e_stop' else _TIMEOUT
        command.add_argument(
            '--timeout',
            type=positive_number,
            default=timeout,
            help=f'time limit of each step [s] (default: {timeout:g})',
        )
        return command

    for name in (*ACTIONS, 'put_back'):
        command = add(name, _MEANING[name])
        _add_waits(command, _WHO.get(name, ' or '.join(BRIDGES)))
        if name == 'e_stop':
            command.add_argument(
                '--all', action='store_true', help='stop the arms of all namespaces'
            )
        if name == 'enable':
            command.add_argument('--home', action='store_true', help=_HOME)
    command = add('go', 'let the active controller move the arm to a joint configuration')
    command.add_argument(
        'angle', type=finite_number, nargs='+', help='joint positions, one per joint [rad]'
    )
    command.add_argument(
        '--tolerance', type=positive_number, default=0.05, help='goal tolerance [rad]'
    )
    command.add_argument(
        '--on-contact',
        choices=REACTIONS,
        default='',
        help='reaction to contact during this motion (default: as set at the controller)',
    )
    command = add('tool', 'let the active Cartesian controller move the tool to a position')
    for axis in 'xyz':
        command.add_argument(axis, type=finite_number, help='tool position in the frame [m]')
    command.add_argument(
        '--frame',
        choices=('base', 'world'),
        default='base',
        help=(
            "frame of the position: 'base' of the arm, or 'world' of the drone's odometry, which "
            'needs world_control (default: base)'
        ),
    )
    command.add_argument(
        '--tolerance', type=positive_number, default=0.01, help='goal tolerance [m]'
    )
    for name, (executable, _, what, meaning) in _PROGRAMS.items():
        command = commands.add_parser(
            name, help=meaning, description=f'{meaning[0].upper()}{meaning[1:]}: {executable}.'
        )
        command.add_argument('what', metavar=what)
        if name == 'record':
            command.add_argument(
                '--here', action='store_true', help='record on this host in any case'
            )
    command = add('set', 'set a live parameter of a node')
    command.add_argument('node', help='node name, for example computed_torque')
    command.add_argument('name', help='parameter name')
    command.add_argument('value', help='new value, for example 0.5, true or "[900.0]"')
    command = add('fault', f'inject a fault into {_FAKE}')
    command.add_argument('fault', metavar=FORM, help=f'NAME is one of {", ".join(FAULTS)}')
    command.add_argument(
        '--bridge', metavar='NODE', default=_FAKE, help='node name of the emulated arm'
    )
    command = add('fetch', _FETCH)
    command.add_argument('what', metavar='NAME', help='name of the bag')
    _add_commission(add('commission', _COMMISSION))
    _add_calibrate(add('calibrate', _CALIBRATE))
    _add_init(commands.add_parser('init', help=_INIT, description=f'{_INIT}.'))
    commands.add_parser(
        'completion',
        help='print shell code that completes the options of all executables in bash or zsh',
    )
    return parser


def _add_arm_files(command: argparse.ArgumentParser) -> None:
    for option, what in (
        ('--config', 'configuration of the bridge'),
        ('--urdf', 'URDF of the arm'),
    ):
        command.add_argument(option, default='', metavar='FILE', help=f'{what} (default: packaged)')


def _add_commission(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add('--joint', action='append', default=[], metavar='NAME', help='joint to commission; may be '
        'repeated (default: all)')  # fmt: skip
    add('--resume', action='store_true', help='only joints that have not passed yet')
    _add_arm_files(command)
    add('--record', default='', metavar='FILE', help=(
        'result file (default: CONFIG.commissioning.yaml next to the configuration)'
    ))  # fmt: skip
    add('--yes', action='store_true', help=(
        'emulated boards only: perform and confirm every manual step automatically'
    ))  # fmt: skip
    add('--bridge', metavar='NODE', default=_FAKE, help='node name of the emulated bridge, for '
        f'--yes (default: {_FAKE})')  # fmt: skip


def _add_calibrate(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add(
        '--postures',
        type=int,
        default=40,
        metavar='N',
        help='number of configurations (default: 40)',
    )
    add('--rest', type=positive_number, default=1.0, help=(
        'rest time in each configuration [s] (default: 1)'
    ))  # fmt: skip
    add('--span', type=positive_number, default=0.8, help=(
        'fraction of the joint ranges to use (default: 0.8)'
    ))  # fmt: skip
    add('--sensors', nargs='+', default=[], metavar='TOPIC', help=(
        'marker and pose topics to record (default: all except the outputs of this suite)'
    ))  # fmt: skip
    add(
        '--link',
        default='',
        metavar='NAME',
        help='link that carries the markers (default: the last)',
    )
    add('--camera', nargs=3, type=finite_number, metavar=('X', 'Y', 'Z'), help=(
        'position of a camera in the base frame [m]; only configurations in which the marker '
        'faces the camera'
    ))  # fmt: skip
    add('--marker-normal', nargs=3, type=finite_number,
        metavar=('X', 'Y', 'Z'), help=(
        'normal of the marker in the frame of its link; needs --camera (default: 0 0 1)'
    ))  # fmt: skip
    _add_arm_files(command)
    add('--excitation-config', default='', metavar='FILE', help=(
        'excitation configuration with clearances and ground (default: packaged)'
    ))  # fmt: skip
    add('--out', default='', metavar='BAG', help='bag to record (default: calibration_DATE_TIME)')
    add('--seed', type=int, default=0, help='seed of the random arm configurations (default: 0)')
    add('--dry-run', action='store_true', help='print the configurations without moving')


def _add_init(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add('urdf', type=Path, help='of the arm')
    add('--name', default='', help='name of the arm and of the files (default: as in the URDF)')
    add(
        '--out',
        type=Path,
        default=Path(),
        metavar='FOLDER',
        help='folder for the files (default: current folder)',
    )
    add(
        '--locked',
        nargs='+',
        default=[],
        metavar='JOINT',
        help='joints to lock, for example fingers',
    )
    add(
        '--gravity',
        type=finite_number,
        nargs=3,
        default=[0.0, 0.0, -9.81],
        metavar=tuple('XYZ'),
        help=(
            'gravity in the frame of the base link [m/s^2] (default: 0 0 -9.81; for a hanging arm '
            '0 0 9.81)'
        ),
    )
    add('--package-directory', type=Path, action='append', default=[], metavar='FOLDER',
        help='search path for package:// meshes')  # fmt: skip
    add('--estimate', type=Path, metavar='FILE', help=(
        'estimate.yaml of the identifier, with identified friction and rotor inertias (default: '
        'guesses)'
    ))  # fmt: skip
    add('--overwrite', action='store_true', help='overwrite existing files')


def _init(options: argparse.Namespace) -> int:
    # Late import, because this command's libraries take a second to load.
    from aerarm_ros.ros.programs.init_run import InitRun

    try:
        InitRun(options).run()
    except (ValueError, OSError) as error:
        print_error(f'{NAME} init', error)
        return USER_ERROR
    return 0


def _add_waits(command: argparse.ArgumentParser, default: str) -> None:
    command.add_argument(
        '--bridge',
        action='append',
        metavar='NODE',
        help=f'node name of the bridge (default: {default})',
    )
    command.add_argument(
        '--wait-before', choices=MODES, metavar='MODE', help='mode to wait for before the request'
    )
    command.add_argument(
        '--wait',
        nargs='+',
        choices=MODES,
        metavar='MODE',
        help='modes to wait for after the request',
    )


def finite_number(text: str) -> float:
    """Convert text of the command line to a finite number; raises ValueError."""
    value = float(text)
    if not isfinite(value):
        raise ValueError(text)
    return value


def positive_number(text: str) -> float:
    """Convert text of the command line to a finite number above zero; raises ValueError."""
    value = finite_number(text)
    if value <= 0.0:
        raise ValueError(text)
    return value


def _become(options: argparse.Namespace, arguments: Sequence[str]) -> NoReturn:
    """Replace this process by another executable, which then receives Ctrl-C."""
    executable, parameter, *_ = _PROGRAMS[options.command]
    given = f'{parameter}:={json.dumps(options.what)}'  # always a text
    begin = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    command = [sys.executable, '-m', 'aerarm_ros.executables', executable]
    sys.stdout.flush()
    os.execv(sys.executable, [*command, '--ros-args', '-p', given, '--', *arguments[begin:]])


def _completion() -> str:
    """Return the script with which bash or zsh completes the arguments of all executables."""
    from argcomplete.shell_integration import shellcode

    names = sorted(path.stem for path in Path(__file__).parent.glob('[a-z]*.py'))
    return f'# eval "$({NAME} completion)"\n{shellcode(names)}'


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; return 0 if the request succeeded."""
    arguments = list(sys.argv[1:] if args is None else args)
    parser = make_parser()
    complete(parser)
    given = without_ros_arguments(arguments)
    if not given:
        parser.print_help()
        parser.exit()
    options = parser.parse_args(given)
    if options.command == 'completion':
        print(_completion())
        return 0
    if options.command == 'init':
        return _init(options)
    # Imported here: help, completion and `init` need no ROS.
    from aerarm_ros.ros.requests.arm_requests import HERE, run_request

    if options.command == 'record' and not options.here:
        status = run_request(options, args)
        if status != HERE:
            return status
    if options.command in _PROGRAMS:
        _become(options, arguments)
    return run_request(options, args)


if __name__ == '__main__':
    sys.exit(main())
