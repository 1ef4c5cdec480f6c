"""YAML text of a draft, which marks guesses and explains how to determine the true values."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Collection
from dataclasses import fields
from typing import Any

from aerarm_ros.description.drive_config import GearConfig, MotorConfig
from aerarm_ros.draft.arm_draft import ArmDraft

MARK = '# guess'
_COLUMN = 38  # text column in which the marks of guessed values begin
_WIDTH = 100
_PLAIN = re.compile(r'[A-Za-z_][A-Za-z_0-9]*')

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
    lines += [
        f'name: {_word(config.name)}',
        _line('', 'emulated_only', 'true', '# hardware_bridge rejects this file'),
        *(_line('', key, _value(getattr(config, key)), MARK) for key in _ARM_KEYS),
        *('', 'boards:'),
    ]
    for board in config.boards:
        lines += [f'  - name: {board.name}', *_entries('    ', board)]
    lines += ['', 'motors:']
    pairs = zip(config.joints, draft.known_rotors, strict=True)
    motors = {joint.motor.name: (joint.motor, is_known) for joint, is_known in pairs}
    for name, (motor, rotor_is_known) in motors.items():
        known = {'rotor_inertia'} if rotor_is_known else set()
        lines += [f'  {name}:', *_entries('    ', motor, known), '    thermal:']
        lines += _entries('      ', motor.thermal_or_guess)
    lines += ['', 'gears:']
    for kind, gear in {joint.gear.kind: joint.gear for joint in config.joints}.items():
        lines += [f'  {kind}:', *_entries('    ', gear)]
    lines += ['', *_about(_JOINT_ADVICE), 'joints:']
    for joint, guesses in zip(config.joints, draft.guesses, strict=True):
        known = {field.name for field in fields(joint)} - guesses
        lines += [f'  - name: {_word(joint.name)}', *_entries('    ', joint, known)]
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
        lines += _comment(_EXCITATION_ADVICE[item.name])
        mark = MARK if item.name in _EXCITATION_GUESSES else ''
        lines.append(_line('', item.name, _value(value), mark))
    return '\n'.join(lines) + '\n'


_ARM_KEYS = ('profile', 'gravity_in_base', 'rest_position', 'rated_payload')
# Fields that `arm_text` does not write as an entry of their own.
_OTHERS = ('name', 'kind', 'thermal', 'encoders')


def _entries(indent: str, config: Any, known: Collection[str] = ()) -> list[str]:
    """Return one line per field of a configuration, with a mark unless the value is known."""
    values = {field.name: getattr(config, field.name) for field in fields(config)}
    return [
        _line(indent, key, _value(value), '' if key in known else MARK)
        for key, value in values.items()
        if key not in _OTHERS and value is not None
    ]


def _about(advice: dict[str, str]) -> list[str]:
    return [line for key, text in advice.items() for line in _comment(f'{key}: {text}', '  ')]


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
    """Return a value as YAML 1.1, which parses a float only with a decimal point."""
    if isinstance(value, tuple):
        return f'[{", ".join(map(_value, value))}]'
    if isinstance(value, float):
        text = repr(value)
        return text if '.' in text or 'e' not in text else text.replace('e', '.0e')
    if isinstance(value, MotorConfig):
        return value.name
    if isinstance(value, GearConfig):
        return value.kind
    return 'null' if value is None else str(value)


def _word(text: str) -> str:
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)
