"""Results of the motor bench as YAML: the numbers, and a configuration that has them."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import read_yaml
from aerarm_ros.identification.motor_bench.motor_bench import Earlier
from aerarm_ros.identification.motor_bench.motor_result import MotorResult
from aerarm_ros.identification.recording.identification_error import IdentificationError

Array = npt.NDArray[np.float64]

_HEADER = """\
# Drives measured on the motor bench, thesis section 4.4. SI units, each number with its standard
# deviation. b_eq [Nms/rad] and rotor_inertia [kg m^2]: motor side; coulomb [Nm] and viscous
# [Nms/rad], backlash [rad]: joint side. resistance [ohm]: of a phase, by the voltages that the
# board reports, or as the board states it (resistance_from). gravity: a, b of g(q) =
# a sin q + b cos q [Nm], as measured with the stated torque constant, at `posture` of the others.
"""

_CONFIG_HEADER = """\
# The arm's configuration with what the motor bench has measured in place of what was there.
# Comments, and values that were not measured: see the file it was made from.
"""

# Effort limits are rounded down to this, so that they stay below what the motor gives [Nm].
_EFFORT_STEP = 0.01


def bench_yaml(
    results: Sequence[MotorResult], posture: Array, mounted: bool, warnings: Sequence[str]
) -> str:
    """Return the text of motor_bench.yaml.

    Parameters
    ----------
    results : sequence of MotorResult
    posture : (n,) ndarray
        In which was measured [rad].
    mounted : bool
        Whether the drives were in the arm.
    warnings : sequence of str
    """
    document = {
        'mounted': mounted,
        'posture': [float(angle) for angle in posture],
        'joints': {result.joint: _entry(result) for result in results},
        'warnings': list(warnings),
    }
    return _HEADER + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


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
    """Read what a run without the known mass found, from its motor_bench.yaml.

    Raises
    ------
    ConfigError, IdentificationError
        If the file can't be read, or is something else.
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
            f'{path}: is no motor_bench.yaml ({type(error).__name__}: {error}): give the file that '
            'the run without the mass wrote'
        ) from None


def config_yaml(source: Path, config: ArmConfig, results: Sequence[MotorResult]) -> str:
    """Return the configuration with measured friction, rotors, torque constants and resistances.

    Joints share kinds of motors, but motors of a kind differ (thesis, chapter 4): a measured
    motor gets an entry of its own.

    Parameters
    ----------
    source : Path
        The configuration's file.
    config : ArmConfig
        What was read from it.
    results : sequence of MotorResult

    Raises
    ------
    ConfigError
        If the file can't be read any more.
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
            # A copy of its own: a shared part would be dumped as an anchor, which is not read.
            motors[joint['motor']] = deepcopy(motors[result.motor]) | measured
            constant = measured.get('torque_constant_measured', result.torque_constant_stated)
            joint['effort_max'] = _effort_max(joint, config, result, constant)
    used = {entry['motor'] for entry in document['joints']}
    document['motors'] = {name: value for name, value in document['motors'].items() if name in used}
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
    return _CONFIG_HEADER + text


def _measured(result: MotorResult) -> dict[str, float]:
    """Return the motor's numbers that are known well enough to be used."""
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
    """Return the joint's effort limit, lowered to what the motor really gives [Nm]."""
    drive = config.joints[config.joint_names.index(result.joint)]
    most = drive.motor.current_max * constant * drive.gear.efficiency / drive.gear.ratio
    lowered = np.floor(most / _EFFORT_STEP) * _EFFORT_STEP
    return float(min(drive.effort_max, round(float(lowered), 6)))
