"""Send one request to the bridge or another node and print the result.

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
        'switch the motors on: the motors first align (THE ARM MOVES), then the bridge holds the '
        'arm'
    ),
    'hold': (
        'let the bridge hold the arm at its position: at once if the arm is damped, or as soon as '
        'the active controller stops'
    ),
    'disable': 'switch the motors off, so that the arm sinks',
    'clear_fault': "end the arm's mode 'fault'; first remove the cause of the fault",
    'home': (
        'find the encoder zeros: turn the joints slowly from the home configuration to the index '
        'pulses of the encoders: THE ARM MOVES'
    ),
    'e_stop': 'emergency stop: the bridge damps the arm until the request clear_fault',
    'put_back': (
        f'reset the arm that the node {_FAKE} simulates to its initial posture, with motors off'
    ),
}
# Receivers of a request if the user names no bridge.
_RECEIVERS = {
    'e_stop': 'all bridges of the ROS namespace; without a namespace, all bridges',
    'disable': 'all bridges of the ROS namespace',
    'put_back': _FAKE,
}
# Commands that run another executable: its name, the parameter to set, the placeholder of its
# value in the help text, and the meaning of the command.
_PROGRAMS = {
    'play': (
        'excitation',
        'trajectory',
        'FILE',
        'play a trajectory file as soon as the arm is ready: THE ARM MOVES',
    ),
    'record': (
        'recorder',
        'bag',
        'NAME',
        'record a bag until Ctrl-C; on the ground computer, this command records the bag on the '
        'drone, then copies the bag to the ground computer',
    ),
}
_FETCH = (
    "copy a bag, which 'arm record' recorded on the drone, to the ground computer; continues an "
    'interrupted copy'
)
_HOME = (
    'before enabling, home the arm if an encoder zero is unknown; the arm must be in its home '
    'configuration'
)
_CALIBRATE = (
    'move the arm to calibration postures and record joint states and sensor data in each posture: '
    'THE ARM MOVES'
)
_INIT = "write the first configuration files of an arm from the arm's URDF"
_COMMISSION = (
    'guide the user through the first power-on of each joint: THE ARM MOVES after a confirmation'
)
_TIMEOUT = 20.0  # [s]
# Twice the longest time that a new node needs to discover a bridge.
_STOP_TIMEOUT = 8.0  # [s]
_PRESS = (
    'press the tool on a wall with a force; 0 0 0 ends the contact; needs the controller '
    'world_control: THE ARM MOVES'
)


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line of `arm`."""
    parser = argparse.ArgumentParser(
        prog=NAME,
        description='Send one request to the bridge or another node and print the result.',
        epilog=(
            f'{NAME} COMMAND --help prints the options of a command. Examples: {NAME} home --wait '
            'ready; '
            f'{NAME} enable --wait ready; {NAME} go 0 1.57 0 0; {NAME} set computed_torque kp '
            "'[900.0]'"
        ),
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    def add(name: str, meaning: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=meaning, description=meaning)
        # A stop request must report sooner that no bridge answers.
        timeout = _STOP_TIMEOUT if name == 'e_stop' else _TIMEOUT
        command.add_argument(
            '--timeout',
            type=positive_number,
            default=timeout,
            help=f'time limit for each step of the command [s] (default: {timeout:g})',
        )
        return command

    for name in (*ACTIONS, 'put_back'):
        command = add(name, _MEANING[name])
        _add_waits(command, _RECEIVERS.get(name, ' or '.join(BRIDGES)))
        if name == 'e_stop':
            command.add_argument('--all', action='store_true',
                help='send the request to the bridges of all namespaces')  # fmt: skip
        if name == 'enable':
            command.add_argument('--home', action='store_true', help=_HOME)
    command = add('go', 'move the arm to a posture with the active controller: THE ARM MOVES')
    command.add_argument('angle', type=finite_number, nargs='+',
        help='joint angles of the posture, one per joint [rad]')  # fmt: skip
    command.add_argument(
        '--tolerance',
        type=positive_number,
        default=0.05,
        help='joint angle error below which the goal counts as reached [rad] (default: 0.05)',
    )
    command.add_argument('--on-contact', choices=REACTIONS, default='',
        help='reaction of the controller to contact during this motion (default: the value of '
             'the parameter contact_reaction)')  # fmt: skip
    command = add(
        'tool', 'move the tool to a position with the active Cartesian controller: THE ARM MOVES'
    )
    _add_vector(command, 'coordinate of the position in --frame [m]')
    command.add_argument('--frame', choices=('base', 'world'), default='base',
        help="frame of the position: 'base' is the arm's base_link; 'world' is the frame of the "
             "drone's odometry, and needs the controller world_control (default: "
             'base)')  # fmt: skip
    command.add_argument('--tolerance', type=positive_number, default=0.01,
        help='distance between tool and position below which the goal counts as reached [m] '
             '(default: 0.01)')  # fmt: skip
    command = add('press', _PRESS)
    _add_vector(command, 'component of the force in the world frame [N]')
    for name, (executable, _, what, meaning) in _PROGRAMS.items():
        command = commands.add_parser(
            name,
            help=meaning,
            description=f'{meaning[0].upper()}{meaning[1:]}. The command starts the node '
            f'{executable}.',
        )
        command.add_argument('what', metavar=what)
        if name == 'record':
            command.add_argument(
                '--here', action='store_true', help='record on this computer, not on the drone'
            )
    command = add('set', 'set a parameter of a running node')
    command.add_argument('node', help='name of the node, for example computed_torque')
    command.add_argument('name', help='name of the parameter')
    command.add_argument(
        'value', help='new value of the parameter, for example 0.5, true or "[900.0]"'
    )
    command = add('fault', f'inject a fault into the boards that the node {_FAKE} emulates')
    command.add_argument(
        'fault', metavar=FORM, help=f'fault to inject; NAME is one of {", ".join(FAULTS)}'
    )
    command.add_argument(
        '--bridge',
        metavar='NODE',
        default=_FAKE,
        help=f'name of the node that emulates the arm (default: {_FAKE})',
    )
    command = add('fetch', _FETCH)
    command.add_argument('what', metavar='NAME', help='name of the bag on the drone')
    _add_commission(add('commission', _COMMISSION))
    _add_calibrate(add('calibrate', _CALIBRATE))
    _add_init(commands.add_parser('init', help=_INIT, description=f'{_INIT}.'))
    commands.add_parser(
        'completion',
        help='print shell code with which bash or zsh completes the options of all executables',
    )
    return parser


def _add_vector(command: argparse.ArgumentParser, meaning: str) -> None:
    for axis in 'xyz':
        command.add_argument(axis, type=finite_number, help=f'{axis} {meaning}')


def _add_arm_files(command: argparse.ArgumentParser) -> None:
    for option, what in (
        ('--config', 'configuration file of the arm, the same as that of the bridge'),
        ('--urdf', 'URDF of the arm'),
    ):
        command.add_argument(
            option, default='', metavar='FILE', help=f'{what} (default: the packaged file)'
        )


def _add_commission(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add('--joint', action='append', default=[], metavar='NAME', help='joint to commission; repeat '
        'the option for several joints (default: all joints)')  # fmt: skip
    add('--resume', action='store_true',
        help='commission only joints that have not passed in an earlier run')  # fmt: skip
    _add_arm_files(command)
    add('--record', default='', metavar='FILE', help=(
        'file for the results (default: CONFIG.commissioning.yaml next to the configuration)'
    ))  # fmt: skip
    add('--yes', action='store_true', help=(
        'perform and confirm all manual steps automatically; with emulated boards only'
    ))  # fmt: skip
    add('--bridge', metavar='NODE', default=_FAKE, help='name of the node that emulates the '
        f'boards, used with --yes (default: {_FAKE})')  # fmt: skip


def _add_calibrate(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add('--postures', type=int, default=40, metavar='N',
        help='number of calibration postures (default: 40)')  # fmt: skip
    add('--rest', type=positive_number, default=1.0, help=(
        'time for which the arm rests in each calibration posture [s] (default: 1)'
    ))  # fmt: skip
    add('--span', type=positive_number, default=0.8, help=(
        'fraction of each joint range in which the program chooses postures (default: 0.8)'
    ))  # fmt: skip
    add('--sensors', nargs='+', default=[], metavar='TOPIC', help=(
        'topics with marker positions or poses to record (default: all topics of these types that '
        'programs outside this suite publish)'
    ))  # fmt: skip
    add('--link', default='', metavar='NAME',
        help='link to which the markers are attached (default: the last link)')  # fmt: skip
    add('--camera', nargs=3, type=finite_number, metavar=('X', 'Y', 'Z'), help=(
        'position of a camera in the base frame [m]; the program then chooses only postures in '
        'which the marker faces the camera'
    ))  # fmt: skip
    add('--marker-normal', nargs=3, type=finite_number, metavar=('X', 'Y', 'Z'), help=(
        'normal vector of the marker, in the frame of the link that carries the marker; needs '
        '--camera (default: 0 0 1)'
    ))  # fmt: skip
    _add_arm_files(command)
    add('--excitation-config', default='', metavar='FILE', help=(
        'YAML file with the minimum clearances of the arm and the height of the ground (default: '
        'the packaged file)'
    ))  # fmt: skip
    add('--out', default='', metavar='BAG',
        help='name of the recorded bag (default: calibration_DATE_TIME)')  # fmt: skip
    add('--seed', type=int, default=0,
        help='seed of the random postures among which the program chooses (default: '
        '0)')  # fmt: skip
    add('--dry-run', action='store_true', help='print the postures without moving the arm')


def _add_init(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add('urdf', type=Path, help='URDF file of the arm')
    add(
        '--name',
        default='',
        help='name of the arm and of the written files (default: the name in the URDF)',
    )
    add('--out', type=Path, default=Path(), metavar='FOLDER',
        help='folder for the written files (default: the current folder)')  # fmt: skip
    add('--locked', nargs='+', default=[], metavar='JOINT',
        help='joints of the URDF that do not belong to the arm, for example gripper joints; the '
             'model treats these joints as fixed')  # fmt: skip
    add('--gravity', type=finite_number, nargs=3, default=[0.0, 0.0, -9.81], metavar=tuple('XYZ'),
        help='gravity in the frame of the base link [m/s^2] (default: 0 0 -9.81; set 0 0 9.81 '
             'for an arm mounted upside down)')  # fmt: skip
    add('--package-directory', type=Path, action='append', default=[], metavar='FOLDER',
        help='folder in which to search for meshes that the URDF names by package:// '
             'addresses')  # fmt: skip
    add('--estimate', type=Path, metavar='FILE', help=(
        'file estimate.yaml of the identifier, with friction and rotor inertias (default: rough '
        'guesses)'
    ))  # fmt: skip
    add('--overwrite', action='store_true', help='overwrite existing files')


def _init(options: argparse.Namespace) -> int:
    # Imported here, because the libraries of this command take a second to load.
    from aerarm_ros.ros.programs.init_run import init_arm

    try:
        init_arm(options)
    except (ValueError, OSError) as error:
        print_error(f'{NAME} init', error)
        return USER_ERROR
    return 0


def _add_waits(command: argparse.ArgumentParser, default: str) -> None:
    command.add_argument(
        '--bridge',
        action='append',
        metavar='NODE',
        help=f'name of the bridge that receives the request (default: {default})',
    )
    command.add_argument('--wait-before', choices=MODES, metavar='MODE',
        help='wait for this mode of the arm before sending the request')  # fmt: skip
    command.add_argument(
        '--wait',
        nargs='+',
        choices=MODES,
        metavar='MODE',
        help='after the request, wait until the arm is in one of these modes',
    )


def finite_number(text: str) -> float:
    """Convert a text to a finite number; raise ValueError if the text is none."""
    value = float(text)
    if not isfinite(value):
        raise ValueError(text)
    return value


def positive_number(text: str) -> float:
    """Convert a text to a positive finite number; raise ValueError if the text is none."""
    value = finite_number(text)
    if value <= 0.0:
        raise ValueError(text)
    return value


def _become(options: argparse.Namespace, arguments: Sequence[str]) -> NoReturn:
    """Replace this process by another executable, which then receives Ctrl-C."""
    executable, parameter, *_ = _PROGRAMS[options.command]
    given = f'{parameter}:={json.dumps(options.what)}'  # quoted, so that ROS reads a string
    begin = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    command = [sys.executable, '-m', 'aerarm_ros.executables', executable]
    sys.stdout.flush()
    os.execv(sys.executable, [*command, '--ros-args', '-p', given, '--', *arguments[begin:]])


def _completion() -> str:
    """Return the shell code with which bash or zsh completes the options of all executables."""
    from argcomplete.shell_integration import shellcode

    names = sorted(path.stem for path in Path(__file__).parent.glob('[a-z]*.py'))
    return f'# eval "$({NAME} completion)"\n{shellcode(names)}'


def main(args: Sequence[str] | None = None) -> int:
    """Run the command that the command line names; return 0 if the command succeeded."""
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
    # Imported here, because help, completion and `init` need no ROS.
    from aerarm_ros.ros.requests.arm_requests import HERE, run_request

    if options.command == 'record' and not options.here:
        status = run_request(options, args)
        if status != HERE:
            return status
    if options.command in _PROGRAMS:
        _become(options, arguments)
    return run_request(options, args)
