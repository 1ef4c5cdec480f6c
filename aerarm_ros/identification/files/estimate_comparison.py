"""What has changed between two identified models of one arm."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.config_reader import read_yaml
from aerarm_ros.identification.parameters.joint_term import COUPLED, TermKind
from aerarm_ros.identification.recording.identification_error import IdentificationError

_CLEAR = 3.0  # standard deviations
_OF_JOINTS = {'viscous': 'Nms/rad', 'coulomb': 'Nm'}
_NOT_FRICTION = (TermKind.ROTOR, *COUPLED)
_FRICTION = tuple(f'{kind.value}_' for kind in TermKind if kind not in _NOT_FRICTION)


@dataclass(frozen=True)
class EstimateChange:
    """One quantity in two results.

    Attributes
    ----------
    name : str
        Such as 'coulomb friction of joint2', or a base parameter.
    unit : str
    old, new : float
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
        """Their difference in standard deviations."""
        return (self.new - self.old) / self.std if self.std > 0.0 else 0.0

    @property
    def is_clear(self) -> bool:
        """Whether it is more than uncertainty explains."""
        return abs(self.deviations) > _CLEAR


@dataclass(frozen=True)
class EstimateComparison:
    """All that two results can be compared in.

    Attributes
    ----------
    friction, inertia : tuple of EstimateChange
        Friction (2.6) of each joint, as it is nearest to the models'; base parameters of links and
        rotors that both motions determine.
    unmatched : int
        Base parameters that only one of the two has.
    """

    friction: tuple[EstimateChange, ...]
    inertia: tuple[EstimateChange, ...]
    unmatched: int

    @property
    def changes(self) -> tuple[EstimateChange, ...]:
        """All of them."""
        return (*self.friction, *self.inertia)


def compare_estimates(old: Path, new: Path) -> EstimateComparison:
    """Compare two files that the identifier has written.

    Parameters
    ----------
    old, new : Path
        estimate.yaml.

    Raises
    ------
    ConfigError
        If a file can't be read.
    IdentificationError
        If one is no estimate with standard deviations, or they are of different arms.
    """
    first, second = (_parameters(path) for path in (old, new))
    if first['joint_names'] != second['joint_names']:
        raise IdentificationError(
            f'{old} is of joints {", ".join(map(str, first["joint_names"]))}, {new} of '
            f'{", ".join(map(str, second["joint_names"]))}: compare two results of one arm'
        )
    try:
        friction = _friction(first, second)
        inertia, unmatched = _inertia(first, second)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise IdentificationError(
            f'{old}, {new}: cannot be compared ({error}): give estimate.yaml as the identifier has '
            'written it, with standard deviations and base parameters'
        ) from None
    return EstimateComparison(friction, inertia, unmatched)


def _parameters(path: Path) -> Mapping[str, Any]:
    try:
        parameters = read_yaml(path)['/**']['ros__parameters']
        if not isinstance(parameters['joint_names'], list):
            raise TypeError
    except (KeyError, TypeError):
        raise IdentificationError(
            f'{path}: is no estimate.yaml: give the file as the identifier has written it'
        ) from None
    return dict(parameters)


def _friction(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[EstimateChange, ...]:
    changes = []
    for key, unit in _OF_JOINTS.items():
        values = [np.array(each[key], dtype=float) for each in (first, second)]
        stds = [np.array(each['standard_deviation'][key], dtype=float) for each in (first, second)]
        rows = zip(first['joint_names'], *values, np.hypot(*stds), strict=True)
        changes += [
            EstimateChange(f'{key} friction of {joint}', unit, *map(float, row))
            for joint, *row in rows
        ]
    return tuple(changes)


def _inertia(
    first: Mapping[str, Any], second: Mapping[str, Any]
) -> tuple[tuple[EstimateChange, ...], int]:
    """Return the changes of base parameters in common, and how many are not."""
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
