"""What has changed between two runs of the motor bench."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.config_reader import read_yaml
from aerarm_ros.identification.files.estimate_comparison import EstimateChange, EstimateComparison
from aerarm_ros.identification.recording.identification_error import IdentificationError

FRICTION = {
    'viscous': ('viscous friction', 'Nms/rad'),
    'coulomb': ('Coulomb friction', 'Nm'),
    'load_friction': ("load's share of friction", ''),
}
INERTIA = {'rotor_inertia': ('rotor inertia', 'kg m²')}
WEAR = {
    'backlash': ('backlash', 'rad'),
    'torque_constant': ('torque constant', 'Nm/A'),
    'resistance': ('resistance', 'Ω'),
}


def compare_benches(old: Path, new: Path) -> EstimateComparison:
    """Compare two files that the motor bench has written, in the joints and numbers of both.

    Parameters
    ----------
    old, new : Path
        motor_bench.yaml.

    Raises
    ------
    ConfigError
        If a file can't be read.
    IdentificationError
        If one is no motor_bench.yaml, or they have no joint in common.
    """
    first, second = (_joints(path) for path in (old, new))
    common = [joint for joint in first if joint in second]
    if not common:
        raise IdentificationError(
            f'{old} is of {", ".join(first)}, {new} of {", ".join(second)}: compare two runs of '
            'the bench with the same joints'
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
            f'{old}, {new}: cannot be compared ({error}): give motor_bench.yaml as the bench has '
            'written it'
        ) from None
    return EstimateComparison(friction, inertia, 0, drives)


def _joints(path: Path) -> Mapping[str, Mapping[str, Any]]:
    try:
        joints = read_yaml(path)['joints']
        return {str(name): dict(entry) for name, entry in joints.items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        raise IdentificationError(
            f'{path}: is no motor_bench.yaml: give the file as the bench has written it'
        ) from None


def _change(joint: str, label: str, unit: str, old: object, new: object) -> EstimateChange:
    (before, spread), (after, other) = (np.array(pair, dtype=float) for pair in (old, new))
    if not np.isfinite([before, spread, after, other]).all():
        raise ValueError(f'{label} of {joint} is no number')
    name, std = f'{label} of {joint}', np.hypot(spread, other)
    return EstimateChange(name, unit, float(before), float(after), float(std))
