"""Send one request to the bridge or another node and print the result.

Usage: ros2 run aerarm_ros arm home --wait ready
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn

from aerarm_ros.executables import command_modules
from aerarm_ros.hardware.bridge_modes import ACTIONS, BRIDGES, MODES
from aerarm_ros.hardware.emulation.fault_injection import FAULTS, FORM
from aerarm_ros.motion.signals import REACTIONS
from aerarm_ros.ros.process.process_end import (
    USER_ERROR,
    print_error,
    print_notice,
    without_ros_arguments,
)
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
_QUIET = 1.5  # [s] of loading without a message to the user
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
        epilog=f'{NAME} COMMAND --help prints the options of a command. Examples: {NAME} home '
        f'--wait ready; {NAME} enable --wait ready; {NAME} go 0 1.57 0 0; '
        f"{NAME} set computed_torque kp '[900.0]'",
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    def add(name: str, meaning: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=meaning, description=meaning)
        # A stop request must report sooner that no bridge answers.
        timeout = _STOP_TIMEOUT if name == 'e_stop' else _TIMEOUT
        _option(command, '--timeout', 'time limit for each step of the command [s]', timeout)
        return command

    for name in (*ACTIONS, 'put_back'):
        _add_service(add(name, _MEANING[name]), name)
    command = add('go', 'move the arm to a posture with the active controller: THE ARM MOVES')
    command.add_argument('angle', type=finite_number, nargs='+',
        help='joint angles of the posture, one per joint [rad]')  # fmt: skip
    _option(command, '--tolerance',
        'joint angle error below which the goal counts as reached [rad]', 0.05)  # fmt: skip
    _option(command, '--on-contact', 'reaction of the controller to contact during this motion', '',
        'the value of the parameter contact_reaction', choices=REACTIONS)  # fmt: skip
    command = add(
        'tool', 'move the tool to a position with the active Cartesian controller: THE ARM MOVES'
    )
    _add_vector(command, 'coordinate of the position in --frame [m]')
    _option(command, '--frame',
        "frame of the position: 'base' is the arm's base_link; 'world' is the frame of the "
        "drone's odometry, and needs the controller world_control", 'base',
        choices=('base', 'world'))  # fmt: skip
    _option(command, '--tolerance',
        'distance between tool and position below which the goal counts as reached [m]',
        0.01)  # fmt: skip
    _add_vector(add('press', _PRESS), 'component of the force in the world frame [N]')
    for name, (executable, _, what, meaning) in _PROGRAMS.items():
        description = (
            f'{meaning[0].upper()}{meaning[1:]}. The command starts the node {executable}.'
        )
        command = commands.add_parser(name, help=meaning, description=description)
        command.add_argument('what', metavar=what)
        if name == 'record':
            _option(command, '--here', 'record on this computer, not on the drone')
    command = add('set', 'set a parameter of a running node')
    command.add_argument('node', help='name of the node, for example computed_torque')
    command.add_argument('name', help='name of the parameter')
    command.add_argument('value',
        help='new value of the parameter, for example 0.5, true or "[900.0]"')  # fmt: skip
    command = add('fault', f'inject a fault into the boards that the node {_FAKE} emulates')
    command.add_argument('fault', metavar=FORM,
        help=f'fault to inject; NAME is one of {", ".join(FAULTS)}')  # fmt: skip
    _option(command, '--bridge', 'name of the node that emulates the arm', _FAKE, metavar='NODE')
    add('fetch', _FETCH).add_argument('what', metavar='NAME', help='name of the bag on the drone')
    _add_commission(add('commission', _COMMISSION))
    _add_calibrate(add('calibrate', _CALIBRATE))
    _add_init(commands.add_parser('init', help=_INIT, description=f'{_INIT}.'))
    commands.add_parser(
        'completion',
        help='print shell code with which bash or zsh completes the options of all executables',
    )
    return parser


def _option(
    command: argparse.ArgumentParser,
    name: str,
    meaning: str,
    default: Any = False,
    otherwise: str = '',
    **settings: Any,
) -> None:
    """Add an option, whose help states the default, or in words what holds `otherwise`.

    A number is positive. An option with the default False is a switch.
    """
    kinds: dict[type, dict[str, Any]] = {
        bool: {'action': 'store_true'},
        int: {'type': int},
        float: {'type': positive_number},
    }
    shown = f'{default:g}' if isinstance(default, float) else str(default)
    has_default = default is not False and (otherwise or isinstance(default, int | float | str))
    text = f'{meaning} (default: {otherwise or shown})' if has_default else meaning
    command.add_argument(
        name, **{**kinds.get(type(default), {}), 'default': default, 'help': text, **settings}
    )


def _add_service(command: argparse.ArgumentParser, name: str) -> None:
    """Add the options of a command that calls a service of the bridge."""
    receivers = _RECEIVERS.get(name, ' or '.join(BRIDGES))
    _option(command, '--bridge', 'name of the bridge that receives the request', [], receivers,
        action='append', metavar='NODE')  # fmt: skip
    command.add_argument('--wait-before', choices=MODES, metavar='MODE',
        help='wait for this mode of the arm before sending the request')  # fmt: skip
    command.add_argument('--wait', nargs='+', choices=MODES, metavar='MODE',
        help='after the request, wait until the arm is in one of these modes')  # fmt: skip
    if name == 'e_stop':
        _option(command, '--all', 'send the request to the bridges of all namespaces')
    if name == 'enable':
        _option(command, '--home', _HOME)


def _add_vector(command: argparse.ArgumentParser, meaning: str) -> None:
    for axis in 'xyz':
        command.add_argument(axis, type=finite_number, help=f'{axis} {meaning}')


_FILES = {
    '--config': 'configuration file of the arm, the same as that of the bridge',
    '--urdf': 'URDF of the arm',
    '--excitation-config': 'YAML file with the minimum clearances of the arm and the height of the '
    'ground',
}


def _add_files(command: argparse.ArgumentParser, *names: str) -> None:
    for name in names:
        _option(command, name, _FILES[name], '', 'the packaged file', metavar='FILE')


def _add_commission(command: argparse.ArgumentParser) -> None:
    add = partial(_option, command)
    add('--joint', 'joint to commission; repeat the option for several joints', [], 'all joints',
        action='append', metavar='NAME')  # fmt: skip
    add('--resume', 'commission only joints that have not passed in an earlier run')
    _add_files(command, '--config', '--urdf')
    add('--record', 'file for the results', '',
        'CONFIG.commissioning.yaml next to the configuration', metavar='FILE')  # fmt: skip
    add('--yes', 'perform and confirm all manual steps automatically; with emulated boards only')
    add('--bridge', 'name of the node that emulates the boards, used with --yes', _FAKE,
        metavar='NODE')  # fmt: skip


def _add_calibrate(command: argparse.ArgumentParser) -> None:
    add = partial(_option, command)
    add('--postures', 'number of calibration postures', 40, metavar='N')
    add('--rest', 'time for which the arm rests in each calibration posture [s]', 1.0)
    add('--span', 'fraction of each joint range in which the program chooses postures', 0.8)
    add('--sensors', 'topics with marker positions or poses to record', [],
        'all topics of these types that programs outside this suite publish',
        nargs='+', metavar='TOPIC')  # fmt: skip
    add('--link', 'link to which the markers are attached', '', 'the last link', metavar='NAME')
    command.add_argument('--camera', nargs=3, type=finite_number, metavar=tuple('XYZ'), help=(
        'position of a camera in the base frame [m]; the program then chooses only postures in '
        'which the marker faces the camera'
    ))  # fmt: skip
    add('--marker-normal',
        'normal vector of the marker, in the frame of the link that carries the marker; needs '
        '--camera', None, '0 0 1', nargs=3, type=finite_number, metavar=tuple('XYZ'))  # fmt: skip
    _add_files(command, '--config', '--urdf', '--excitation-config')
    add('--out', 'name of the recorded bag', '', 'calibration_DATE_TIME', metavar='BAG')
    add('--seed', 'seed of the random postures among which the program chooses', 0)
    add('--dry-run', 'print the postures without moving the arm')


def _add_init(command: argparse.ArgumentParser) -> None:
    add = partial(_option, command)
    command.add_argument('urdf', type=Path, help='URDF file of the arm')
    add('--name', 'name of the arm and of the written files', '', 'the name in the URDF')
    add('--out', 'folder for the written files', Path(), 'the current folder', type=Path,
        metavar='FOLDER')  # fmt: skip
    command.add_argument('--locked', nargs='+', default=[], metavar='JOINT', help=(
        'joints of the URDF that do not belong to the arm, for example gripper joints; the '
        'model treats these joints as fixed'
    ))  # fmt: skip
    add('--gravity', 'gravity in the frame of the base link [m/s^2]', [0.0, 0.0, -9.81],
        '0 0 -9.81; set 0 0 9.81 for an arm mounted upside down', nargs=3, type=finite_number,
        metavar=tuple('XYZ'))  # fmt: skip
    command.add_argument('--package-directory', type=Path, action='append', default=[],
        metavar='FOLDER', help=(
        'folder in which to search for meshes that the URDF names by package:// addresses'
    ))  # fmt: skip
    add('--estimate', 'file estimate.yaml of the identifier, with friction and rotor inertias',
        None, 'rough guesses', type=Path, metavar='FILE')  # fmt: skip
    add('--overwrite', 'overwrite existing files')


def _init(options: argparse.Namespace) -> int:
    # Imported here, because the libraries of this command take a second to load.
    from aerarm_ros.ros.programs.init_run import init_arm

    try:
        init_arm(options)
    except (ValueError, OSError) as error:
        print_error(f'{NAME} init', error)
        return USER_ERROR
    return 0


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

    return f'# eval "$({NAME} completion)"\n{shellcode(list(command_modules()))}'


def _report_loading(*_: object) -> None:
    print_notice(NAME, 'waiting for ROS 2 to load; the request follows')


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
    before = signal.signal(signal.SIGALRM, _report_loading)
    signal.setitimer(signal.ITIMER_REAL, _QUIET)
    try:
        # Imported here, because help, completion and `init` need no ROS.
        from aerarm_ros.ros.requests.arm_requests import HERE, run_request
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    if options.command == 'record' and not options.here:
        status = run_request(options, args)
        if status != HERE:
            return status
    if options.command in _PROGRAMS:
        _become(options, arguments)
    return run_request(options, args)
