"""Motor bench results as YAML, as configuration, and as table 4.3 and figure 4.4 of the thesis."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import read_yaml, yaml_text
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_backlash import is_significant
from aerarm_ros.identification.motor_bench.motor_bench import Earlier, MotorResult
from aerarm_ros.identification.motor_bench.motor_friction import BOARD
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import (
    Html,
    bullets,
    origin,
    page,
    paragraph,
    section,
    table,
    text_table,
)
from aerarm_ros.pages.plots import StackedFigure, plotting_script

_HEADER = """\
# Drives measured on the motor bench, thesis section 4.4. SI units, each number with its standard
# deviation. b_eq [Nms/rad] and rotor_inertia [kg m^2]: at the motor. coulomb [Nm], viscous
# [Nms/rad] and backlash [rad]: at the joint. resistance [ohm]: resistance of one phase;
# resistance_from is 'voltage' if it was measured with the voltages that the board reports, 'board'
# if the board reports the resistance. gravity: a and b of the joint's gravity torque
# g(q) = a sin q + b cos q [Nm], computed with the configured torque constant. All other joints
# were at `posture` during the measurement.
"""

_CONFIG_HEADER = """\
# The arm's configuration with the values that the motor bench has measured. All other values are
# copied from the original configuration. Comments are omitted.
"""

# Effort limits are rounded down to multiples of this, to stay below the motor's torque [Nm].
_EFFORT_STEP = 0.01


def bench_yaml(
    results: Sequence[MotorResult], posture: Array, mounted: bool, warnings: Sequence[str]
) -> str:
    """Return the text of motor_bench.yaml.

    Parameters
    ----------
    posture : (n,) ndarray
        Posture of the measurement [rad].
    mounted : bool
        Whether the drives were mounted in the arm.
    """
    document = {
        'mounted': mounted,
        'posture': [float(angle) for angle in posture],
        'joints': {result.joint: _entry(result) for result in results},
        'warnings': list(warnings),
    }
    return _HEADER + yaml_text(document)


def _entry(result: MotorResult) -> dict[str, Any]:
    friction = result.friction
    entry: dict[str, Any] = {
        'motor': result.motor,
        'b_eq': _pair(result.viscous_motor),
        'coulomb': _pair(result.coulomb),
        'viscous': _pair(result.viscous),
        'load_friction': _pair((friction.load, friction.std[2])),
        'gravity': [float(value) for value in friction.gravity],
    }
    for name in ('rotor_inertia', 'torque_constant', 'backlash'):
        value = getattr(result, name)
        if value is not None:
            entry[name] = _pair(value)
    if result.resistance is not None:
        entry['resistance'] = [result.resistance.ohm, result.resistance.std]
        entry['resistance_from'] = result.resistance.source
    return entry


def _pair(value: tuple[float, float]) -> list[float]:
    return [float(value[0]), float(value[1])]


def load_earlier(path: Path) -> Earlier:
    """Read the results of a run without the known mass from a motor_bench.yaml.

    Raises
    ------
    ConfigError, IdentificationError
        If the file cannot be read, or is not a motor bench result.
    """
    document = read_yaml(path)
    try:
        gravity = {
            str(joint): np.array(entry['gravity'], dtype=float).reshape(2)
            for joint, entry in document['joints'].items()
        }
        return Earlier(gravity, np.array(document['posture'], dtype=float).reshape(-1))
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise IdentificationError(
            f'{path} is not a motor_bench.yaml ({type(error).__name__}: {error}): pass the file '
            'that the run without the mass wrote'
        ) from None


def config_yaml(source: Path, config: ArmConfig, results: Sequence[MotorResult]) -> str:
    """Return the configuration with measured friction, rotor inertia, K_i and phase resistance.

    Joints share motor types, but individual motors differ (thesis, chapter 4). So each measured
    motor gets a separate entry.

    Parameters
    ----------
    source : Path
        Path of the configuration file.
    config : ArmConfig
        Configuration read from that file.

    Raises
    ------
    ConfigError
        If the file can no longer be read.
    """
    document = read_yaml(source)
    entries = {entry['name']: entry for entry in document['joints']}
    for result in results:
        joint, motors = entries[result.joint], document['motors']
        joint['viscous'] = max(result.viscous[0], 0.0)
        joint['coulomb'] = result.coulomb[0]
        measured = _measured(result)
        if measured:
            joint['motor'] = f'{result.motor}_{result.joint}'
            # Each joint gets its own copy, because YAML writes shared objects as anchors, which
            # the configuration reader rejects.
            motors[joint['motor']] = deepcopy(motors[result.motor]) | measured
            constant = measured.get('torque_constant_measured', result.torque_constant_stated)
            joint['effort_max'] = _effort_max(joint, config, result, constant)
    used = {entry['motor'] for entry in document['joints']}
    document['motors'] = {name: value for name, value in document['motors'].items() if name in used}
    return _CONFIG_HEADER + yaml_text(document)


def _measured(result: MotorResult) -> dict[str, float]:
    """Return the measured motor parameters that are accurate enough for the configuration file."""
    measured = {}
    if result.rotor_inertia is not None and result.rotor_inertia_known:
        measured['rotor_inertia'] = result.rotor_inertia[0]
    if result.torque_constant is not None:
        measured['torque_constant_measured'] = result.torque_constant[0]
    if result.resistance is not None:
        measured['resistance'] = result.resistance.ohm
        measured['resistance_std'] = result.resistance.std
    return measured


def _effort_max(
    joint: Mapping[str, Any], config: ArmConfig, result: MotorResult, constant: float
) -> float:
    """Return the joint's effort limit [Nm], lowered to the torque that the motor provides."""
    drive = config.joints[config.joint_names.index(result.joint)]
    most = drive.motor.current_max * constant * drive.gear.efficiency / drive.gear.ratio
    lowered = np.floor(most / _EFFORT_STEP) * _EFFORT_STEP
    return float(min(drive.effort_max, round(float(lowered), 6)))


_HEADINGS = (
    'joint',
    'motor',
    'b_eq [Nms/rad]',
    'f [Nm]',
    'J_m [kg m²]',
    'K_i [Nm/A]',
    'R [Ω]',
    'backlash [mrad]',
)


def bench_table(results: Sequence[MotorResult]) -> str:
    """Return a table like thesis table 4.3, with standard deviations, for the terminal."""
    return text_table([_HEADINGS, *map(_cells, results)])


def bench_html(results: Sequence[MotorResult], mounted: bool, warnings: Sequence[str]) -> str:
    """Return the report of a bench as one self-contained HTML page.

    Parameters
    ----------
    mounted : bool
        Whether the drives were mounted in the arm.
    """
    how = (
        'The drives were mounted in the arm. The fit includes gravity, g(q) = a sin q + b cos q '
        'for each joint, and the load-dependent gear friction. The plots show torque without '
        'gravity torque and without load-dependent friction.'
        if mounted
        else 'The motors were bare, so gravity caused no torque.'
    )
    parts = [
        paragraph('Friction (4.12)-(4.14) of each drive, with standard deviations.', 'lead'),
        bullets(warnings, 'warnings') if warnings else '',
        section('Parameters', table(_HEADINGS, map(_page_row, results))),
        paragraph(
            'b_eq and J_m are motor-side values, f is a joint-side value. A J_m in brackets may '
            'include inertia of the load. K_i and R in brackets are '
            'configured values. R is the resistance of one phase, from the voltages that the '
            'board reports. The backlash at the joint is estimated from the sinusoidal swings; a '
            'backlash in brackets is not significant.',
            'note',
        ),
        section('Motor torque over motor speed', paragraph(how, 'note'), _figure(results)),
    ]
    return page('Motor bench', plotting_script(), parts, origin())


def _cells(result: MotorResult) -> tuple[str, ...]:
    ohmic, backlash = result.resistance, result.backlash
    constant = result.torque_constant
    return (
        result.joint,
        result.motor,
        _cell(result.viscous_motor),
        _cell(result.coulomb),
        _cell(result.rotor_inertia, result.rotor_inertia_known),
        _cell(constant) if constant else f'({result.torque_constant_stated:.4f})',
        _cell((ohmic.ohm, ohmic.std), ohmic.source != BOARD) if ohmic else '-',
        _cell((1e3 * backlash[0], 1e3 * backlash[1]), is_significant(backlash))
        if backlash
        else '-',
    )


def _page_row(result: MotorResult) -> list[str]:
    """Return the table cells of one drive for the page; numbers do not wrap in the cells."""
    joint, motor, *numbers = _cells(result)
    return [joint, motor, *map(Html, numbers)]


def _cell(value: tuple[float, float] | None, is_certain: bool = True) -> str:
    """Return a value with its standard deviation as text, an uncertain value in brackets."""
    if value is None:
        return '-'
    text = f'{value[0]:.3g} ± {value[1]:.1g}'
    return text if is_certain else f'({text})'


def _figure(results: Sequence[MotorResult]) -> Html:
    """Return a figure like thesis figure 4.4: torque and fit over speed, one plot per drive."""
    rows = tuple(f'{result.joint} ({result.motor}) τ_m' for result in results)
    figure = StackedFigure(rows, 'Nm', 'ω_m [rad/s]')
    for row, result in enumerate(results):
        kg, friction = result.ratio, result.friction
        speed, torque = friction.speed / kg, result.scale * friction.torque * kg
        # Two points next to zero speed make the curve show the step of sgn.
        reach = float(np.abs(speed).max(initial=0.0))
        line = np.array([-reach, -1e-9, 1e-9, reach])
        fit = result.viscous_motor[0] * line + result.coulomb[0] * kg * np.sign(line)
        figure.add(row, speed, torque, 'measured', 'cloud')
        figure.add(row, line, fit, 'b ω_m + f k_g sgn(ω_m)', 'predicted')
    return figure.html('friction')
