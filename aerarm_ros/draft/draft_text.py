"""YAML text of a draft, which marks guesses and explains how to determine the true values."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import fields

from aerarm_ros.description.drive_config import GearConfig, JointConfig, MotorConfig, ThermalConfig
from aerarm_ros.draft.arm_draft import ArmDraft

MARK = '# guess'
_COLUMN = 38  # text column in which the marks of guessed values begin
_WIDTH = 100
_PLAIN = re.compile(r'[A-Za-z_][A-Za-z_0-9]*')
_ROTOR = 'rotor_inertia'
_PARTS = ('motor', 'gear')

_HEAD = """\
The drive train of {name}: motors, gears, boards and joint limits. Drafted from
{source}. SI units, on the joint side unless a line says motor side.

Values that a URDF does not contain are marked "guess". Guessed values suit emulated boards, but
not real motors. Replace each guess by the real value and delete its mark. Then delete the line
emulated_only."""

# Advice on how to determine each value that may be guessed.
_ARM_ADVICE = {
    'profile': (
        "layout of the boards' frames: a name in config/profiles, or the path of another profile."
    ),
    'gravity_in_base': '[m/s^2], gravity in the frame of the base link, as the base is mounted. '
    'An arm that hangs upside down has [0, 0, 9.81].',
    'rest_position': (
        '[rad], in the order of the joints: a posture without collisions that is easy to hold, '
        'according to the URDF. Check the posture in the browser (view), or set the posture in '
        'which the arm is parked.'
    ),
    'rated_payload': 'the largest payload: mass [kg], and x, y, z of its centre of mass in the '
    "frame of the last link's joint [m]. Weigh the payload: its mass "
    'enters the limits.',
    'boards': 'numbered from 0, with two motors per board. device: SPI bus and chip select of the '
    "board; `ls /dev/spidev*` lists the devices. clock_hz, mode: from the boards' documents.",
    'motors': 'pole_pairs, kv [rpm/V], current_max [A], resistance [ohm, phase to neutral]: from '
    'the data sheet; this draft computes them from effort limit and gear. '
    'rotor_inertia [kg m^2], and a torque_constant_measured [Nm/A] to add: from '
    'motor_bench. thermal: continuous_current [A] keeps the winding below '
    'temperature_max [degC] as the motor is mounted, without the airflow of a '
    'propeller; winding_time, housing_time [s] are time constants, housing_share is '
    'the fraction of the thermal resistance outside the housing. To measure them, let '
    'the motor hold a load.',
    'gears': 'ratio = joint speed / motor speed: from the data sheet, or count the motor turns '
    'per joint turn. efficiency stays 1 if losses are identified as friction.',
}
_JOINT_ADVICE = {
    'motor, gear': "names of the joint's motor and gear in the lists above.",
    'board, channel': 'board (its number in the list above) and channel of the motor: look where '
    'the motor is plugged in.',
    'sign, offset': 'joint angle = sign * ratio * motor angle + offset. With the motors off, '
    'turn the joint by hand and watch joint_states. If the reported angle falls '
    'while the joint turns in positive direction, set sign to -1. offset [rad] '
    'is the joint angle at which the encoder reads zero.',
    'position_min, position_max': '[rad] from the URDF, or half a turn to each side: set the '
    'range that cables and stops allow.',
    'velocity_max': (
        '[rad/s] from the URDF, or a low default: set a value well below the no-load speed of the '
        'motor.'
    ),
    'acceleration_max': '[rad/s^2] half of the acceleration that effort_max allows against gravity '
    'with the outstretched arm, and at least full speed after 0.1 s: set a value that gears and '
    'mount withstand.',
    'effort_max': '[Nm] from the URDF, or three times the weight: at most torque constant * '
    'current_max / ratio, and at most the torque that the gear withstands.',
    'effort_rate_max': '[Nm/s] effort_max per 17 ms: set a rate that the gear teeth withstand.',
    'viscous, coulomb': 'friction [Nms/rad], [Nm] from the URDF, or typical of light drives: use '
    'the fv and fs of identifier or motor_bench.',
    'board_kp, board_kd': (
        'gains at the motor [A/rad], [A s/rad]: with the inertias above, the motion is damped in '
        'every posture. Tune them again for other motors or gears, see docs/how-to/tuning.md.'
    ),
}


def arm_text(draft: ArmDraft, source: str) -> str:
    """Return the drafted drive train as YAML.

    Parameters
    ----------
    source : str
        File name of the URDF, for the header.
    """
    config = draft.config
    lines = [*_comment(_HEAD.format(name=config.name, source=source)), '', *_about(_ARM_ADVICE), '']
    add = lines.append
    add(f'name: {_word(config.name)}')
    add(_line('', 'emulated_only', 'true', '# hardware_bridge rejects this file'))
    add(_line('', 'profile', config.profile, MARK))
    add(_line('', 'gravity_in_base', _list(config.gravity_in_base), MARK))
    add(_line('', 'rest_position', _list(config.rest_position), MARK))
    add(_line('', 'rated_payload', _list(config.rated_payload), MARK))
    lines += ['', 'boards:']
    for board in config.boards:
        lines.append(f'  - name: {board.name}')
        for key in ('device', 'clock_hz', 'mode'):
            add(_line('    ', key, str(getattr(board, key)), MARK))
    lines += ['', 'motors:']
    pairs = zip(config.joints, draft.known_rotors, strict=True)
    motors = {joint.motor.name: (joint.motor, is_known) for joint, is_known in pairs}
    for name, (motor, rotor_is_known) in motors.items():
        values = [(item.name, getattr(motor, item.name)) for item in fields(MotorConfig)]
        add(f'  {name}:')
        lines += [
            _line('    ', key, _number(value), '' if key == _ROTOR and rotor_is_known else MARK)
            for key, value in values
            if key not in ('name', 'thermal') and value is not None
        ]
        add('    thermal:')
        lines += [
            _line('      ', item.name, _number(getattr(motor.thermal_or_guess, item.name)), MARK)
            for item in fields(ThermalConfig)
        ]
    lines += ['', 'gears:']
    for kind, gear in {joint.gear.kind: joint.gear for joint in config.joints}.items():
        values = [(f.name, getattr(gear, f.name)) for f in fields(GearConfig) if f.name != 'kind']
        add(f'  {kind}:')
        lines += [_line('    ', key, _number(value), MARK) for key, value in values]
    lines += ['', *_about(_JOINT_ADVICE), 'joints:']
    for joint, guesses in zip(config.joints, draft.guesses, strict=True):
        lines += _joint(joint, guesses)
    return '\n'.join(lines) + '\n'


_EXCITATION_ADVICE = {
    'position_share': "usable fraction of each joint's range, about its middle.",
    'velocity_share': 'usable fraction of the velocity and acceleration limits.',
    'effort_share': 'usable fraction of the torque and motor current limits.',
    'transfer_share': (
        'fraction of the usable velocity and acceleration for motions to the trajectory and back.'
    ),
    'self_clearance': (
        '[m] smallest distance between links that are not neighbours: allow for cables and screws '
        'outside the collision shapes.'
    ),
    'ground_clearance': '[m] smallest distance from the ground.',
    'ground_height': '[m] height of the ground above the base frame, negative if the ground is '
    'below: measure it; null if no ground is in reach. Model a table, a wall or a landing gear '
    'in the URDF, as collision shapes of the base.',
    'bias': '[rad] centre of the motion: the home configuration.',
    'bias_spread': '[rad] largest random offset from bias.',
    'highest_frequency': (
        '[Hz] highest frequency of a harmonic: well below the first bending mode. To find this '
        'mode, tap the arm while its motors hold it, and look at the oscillation of its '
        'velocities.'
    ),
    'ramp_time': '[s] duration of run-in and run-out along the trajectory.',
    'unchecked_pairs': "links that touch by construction, as 'one to other': never checked "
    'for collisions.',
    'check_clearance': 'false moves the arm without any collision check: use it only if the URDF '
    'has no readable collision shapes.',
}
_EXCITATION_GUESSES = (
    *('self_clearance', 'ground_clearance', 'ground_height', 'bias', 'highest_frequency'),
    *('unchecked_pairs', 'check_clearance'),
)


def excitation_text(draft: ArmDraft, source: str) -> str:
    """Return the excitation settings as YAML."""
    head = (
        f'Limits of an excitation of {draft.config.name}. Drafted from {source}; values that a '
        'URDF does not contain are marked "guess".'
    )
    lines = [*_comment(head), '']
    for item in fields(draft.excitation):
        value = getattr(draft.excitation, item.name)
        lines += _about({item.name: _EXCITATION_ADVICE[item.name]}, names=False)
        text = 'null' if value is None else _value(value)
        mark = MARK if item.name in _EXCITATION_GUESSES else ''
        lines.append(_line('', item.name, text, mark))
    return '\n'.join(lines) + '\n'


def _joint(joint: JointConfig, guesses: Iterable[str]) -> list[str]:
    lines = [f'  - name: {_word(joint.name)}']
    for item in fields(joint):
        if item.name == 'name':
            continue
        value = getattr(joint, item.name)
        text = {'motor': joint.motor.name, 'gear': joint.gear.kind}.get(item.name)
        mark = MARK if item.name in guesses else ''
        lines.append(_line('    ', item.name, text or _number(value), mark))
    return lines


def _about(advice: dict[str, str], names: bool = True) -> list[str]:
    lines: list[str] = []
    for key, text in advice.items():
        lines += _comment(f'{key}: {text}' if names else text, hanging='  ' if names else '')
    return lines


def _comment(text: str, hanging: str = '') -> list[str]:
    lines: list[str] = []
    for paragraph in text.split('\n\n'):
        lines += ['#'] if lines else []
        lines += textwrap.wrap(
            ' '.join(paragraph.split()),
            _WIDTH,
            initial_indent='# ',
            subsequent_indent=f'# {hanging}',
            break_on_hyphens=False,
        )
    return lines


def _line(indent: str, key: str, text: str, mark: str) -> str:
    line = f'{indent}{key}: {text}'
    return f'{line:<{_COLUMN - 1}} {mark}' if mark else line


def _value(value: object) -> str:
    return _list(value) if isinstance(value, tuple) else _number(value)


def _list(values: Sequence[object]) -> str:
    return f'[{", ".join(map(_number, values))}]'


def _number(value: object) -> str:
    """Return a number as text that YAML 1.1 parses as a number; floats need a decimal point."""
    if isinstance(value, float):
        text = repr(value)
        return text if '.' in text or 'e' not in text else text.replace('e', '.0e')
    return str(value)


def _word(text: str) -> str:
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)
