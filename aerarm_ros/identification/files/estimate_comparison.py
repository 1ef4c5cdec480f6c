"""Comparison of two identified models of the same arm."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.config_reader import read_yaml
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import (
    friction_torque,
    joint_terms,
    ros_parameters,
)
from aerarm_ros.identification.joint_model import NOT_FRICTION, JointTerm, TermKind
from aerarm_ros.motion.signals import Array

_CLEAR = 3.0  # standard deviations
_SHARES = (0.2, 0.6, 1.0)  # fraction of the speed that both motions reach
_STILL = 1e-3  # [rad/s]
_FRICTION = tuple(f'{kind.value}_' for kind in TermKind if kind not in NOT_FRICTION)


@dataclass(frozen=True)
class EstimateChange:
    """Change of one quantity between two results.

    Attributes
    ----------
    name : str
        Name of the quantity, for example 'friction of joint2 at 0.5 rad/s', or of a base parameter.
    old, new : float
        Value in the old and the new result.
    std : float
        Standard deviation of their difference.
    """

    name: str
    unit: str
    old: float
    new: float
    std: float

    @property
    def deviations(self) -> float:
        """Difference between the new and the old value, in standard deviations."""
        return (self.new - self.old) / self.std if self.std > 0.0 else 0.0

    @property
    def is_clear(self) -> bool:
        """Whether the difference exceeds three standard deviations."""
        return abs(self.deviations) > _CLEAR


@dataclass(frozen=True)
class EstimateComparison:
    """Changes of all quantities that two results have in common.

    Attributes
    ----------
    friction, inertia : tuple of EstimateChange
        Changes of each joint's friction torque at several speeds that both motions reach, for the
        same load; and changes of the base parameters of links and rotors that both motions
        determine.
    unmatched : int
        Number of base parameters that only one of the results contains.
    drives : tuple of EstimateChange
        Changes of further quantities measured on a motor bench, such as backlash.
    """

    friction: tuple[EstimateChange, ...]
    inertia: tuple[EstimateChange, ...]
    unmatched: int
    drives: tuple[EstimateChange, ...] = ()

    @property
    def changes(self) -> tuple[EstimateChange, ...]:
        """Changes of all quantities: friction, inertia and drives."""
        return (*self.friction, *self.inertia, *self.drives)


def compare_estimates(old: Path, new: Path) -> EstimateComparison:
    """Compare two estimate files written by the identifier.

    Parameters
    ----------
    old, new : Path
        Paths of two files estimate.yaml.

    Raises
    ------
    ConfigError
        If a file cannot be read.
    IdentificationError
        If a file is not an estimate with standard deviations, or the arms differ.
    """
    first, second = map(ros_parameters, (old, new))
    if first['joint_names'] != second['joint_names']:
        raise IdentificationError(
            f'{old} has joints {", ".join(map(str, first["joint_names"]))}, {new} has '
            f'{", ".join(map(str, second["joint_names"]))}: compare two results of one arm'
        )
    try:
        friction = _friction(first, second)
        inertia, unmatched = _inertia(first, second)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise IdentificationError(
            f'{old} and {new} cannot be compared ({error}): pass estimate.yaml files of the '
            'identifier; identify again if the files have an older format'
        ) from None
    return EstimateComparison(friction, inertia, unmatched)


@dataclass(frozen=True, eq=False)
class _JointFriction:
    """Friction model of one joint, from one of the two compared results."""

    terms: Mapping[JointTerm, float]
    speeds: Array
    torques: Array
    load: float
    load_deviation: float

    def at(self, speed: Array, load: float) -> tuple[Array, Array]:
        """Return friction torques and their standard deviations [Nm] at given speeds and load."""
        known = np.interp(speed, self.speeds, self.torques)
        elsewhere = self.load_deviation * (load - self.load)
        return friction_torque(self.terms, speed, load), np.hypot(known, elsewhere)


def _joints(parameters: Mapping[str, Any]) -> list[_JointFriction]:
    n = len(parameters['joint_names'])
    deviations = parameters['friction_deviations']
    speeds, torques = (
        np.array(deviations[key], dtype=float).reshape(n, -1) for key in ('speeds', 'torques')
    )
    loads = np.array(deviations['loads'], dtype=float).reshape(n)
    of_load = np.array(parameters['standard_deviation']['load'], dtype=float).reshape(n)
    own = zip(joint_terms(parameters, n), speeds, torques, loads, of_load, strict=True)
    return [_JointFriction(*each) for each in own]


def _friction(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[EstimateChange, ...]:
    changes = []
    for name, *pair in zip(first['joint_names'], _joints(first), _joints(second), strict=True):
        top = min(float(each.speeds[-1]) for each in pair)
        if top < _STILL:
            continue
        speeds = top * np.array(_SHARES)
        load = float(np.mean([each.load for each in pair]))
        (old, old_std), (new, new_std) = (each.at(speeds, load) for each in pair)
        changes += [
            EstimateChange(f'friction of {name} at {speed:.2g} rad/s', 'Nm', *map(float, row))
            for speed, *row in zip(speeds, old, new, np.hypot(old_std, new_std), strict=True)
        ]
    return tuple(changes)


def _inertia(
    first: Mapping[str, Any], second: Mapping[str, Any]
) -> tuple[tuple[EstimateChange, ...], int]:
    """Return the changes of common base parameters, and the number of other base parameters."""
    old, new = (_base(each['base_parameters']) for each in (first, second))
    common = [name for name in old if name in new]
    changes = tuple(
        EstimateChange(
            name, '', old[name][0], new[name][0], float(np.hypot(old[name][1], new[name][1]))
        )
        for name in common
    )
    return changes, len(old) + len(new) - 2 * len(common)


def _base(base: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    rows = zip(base['expressions'], base['values'], base['standard_deviations'], strict=True)
    return {
        str(name): (float(value), float(std))
        for name, value, std in rows
        if not str(name).startswith(_FRICTION)
    }


FRICTION = {
    'viscous': ('viscous friction', 'Nms/rad'),
    'coulomb': ('Coulomb friction', 'Nm'),
    'load_friction': ('load-dependent friction', ''),
}
INERTIA = {'rotor_inertia': ('rotor inertia', 'kg m²')}
WEAR = {
    'backlash': ('backlash', 'rad'),
    'torque_constant': ('torque constant', 'Nm/A'),
    'resistance': ('resistance', 'Ω'),
}


def compare_benches(old: Path, new: Path) -> EstimateComparison:
    """Compare the common joints and quantities of two motor bench files.

    Parameters
    ----------
    old, new : Path
        Paths of two files motor_bench.yaml.

    Raises
    ------
    ConfigError
        If a file cannot be read.
    IdentificationError
        If a file is not a motor_bench.yaml, or no joint is in both files.
    """
    first, second = (_bench_joints(path) for path in (old, new))
    common = [joint for joint in first if joint in second]
    if not common:
        raise IdentificationError(
            f'{old} has joints {", ".join(first)}, {new} has {", ".join(second)}: compare two '
            'runs of the motor bench with the same joints'
        )
    try:
        friction, inertia, drives = (
            tuple(
                _change(joint, label, unit, first[joint][key], second[joint][key])
                for joint in common
                for key, (label, unit) in quantities.items()
                if key in first[joint] and key in second[joint]
            )
            for quantities in (FRICTION, INERTIA, WEAR)
        )
    except (TypeError, ValueError) as error:
        raise IdentificationError(
            f'{old} and {new} cannot be compared ({error}): pass unchanged motor_bench.yaml files'
        ) from None
    return EstimateComparison(friction, inertia, 0, drives)


def _bench_joints(path: Path) -> Mapping[str, Mapping[str, Any]]:
    try:
        joints = read_yaml(path)['joints']
        return {str(name): dict(entry) for name, entry in joints.items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        raise IdentificationError(
            f'{path} is not a motor_bench.yaml: pass the unchanged file of the motor bench'
        ) from None


def _change(joint: str, label: str, unit: str, old: object, new: object) -> EstimateChange:
    (before, spread), (after, other) = (np.array(pair, dtype=float) for pair in (old, new))
    if not np.isfinite([before, spread, after, other]).all():
        raise ValueError(f'the value {label} of {joint} is not a number')
    name, std = f'{label} of {joint}', np.hypot(spread, other)
    return EstimateChange(name, unit, float(before), float(after), float(std))
